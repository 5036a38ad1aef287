// SPDX-License-Identifier: BSD-3-Clause
//
// Fronts of houses, drawn point by point: each seed is another house, with its wall, windows, door, shop and
// posters.
#include <algorithm>

#include "texture.h"

namespace mapping_simulation {
namespace {

// What is drawn by chance for a house, or for a part (i, j) of it.
enum Draw : std::uint32_t {
  kWall,
  kWallTone,
  kCell,
  kWindowWidth,
  kWindowHeight,
  kPanes,
  kFrame,
  kShutters,
  kShop,
  kDoor,
  kStone,  // house
  kGlass,
  kBlind,
  kCurtain,
  kLit,
  kPoster,
  kPaper,
  kGoods,
  kGlyph,
  kBrick  // parts
};

Color grey(double value) {
  return Color::Constant(static_cast<float>(value));
}

class Facade {
 public:
  Facade(const Texture& texture, const Eigen::Vector2d& uv)
      : seed_(texture.seed * 2654435761u),
        storey_(texture.size),
        u_(uv.x() + 0.5 * texture.span),
        v_(uv.y()),
        columns_(std::max(1.0, std::round(texture.span / (1.7 + 1.3 * draw(kCell))))),
        cell_(texture.span / columns_),
        level_(std::floor(v_ / storey_)),
        column_(std::clamp(std::floor(u_ / cell_), 0.0, columns_ - 1.0)),
        x_(u_ - (column_ + 0.5) * cell_),
        y_(v_ - level_ * storey_),
        stone_(grey(0.45 + 0.35 * draw(kStone))) {}

  Appearance seen() const {
    if (level_ <= 0.0) return groundFloor();
    if (y_ < 0.12) return {stone_};
    if (y_ > storey_ - 0.15) return {stone_ * (std::fmod(u_, 0.4) < 0.2 ? 0.9f : 0.55f)};
    return window(0.28 * storey_);
  }

 private:
  double draw(Draw what) const { return cellValue(what, -1, seed_); }
  double draw(Draw what, double i, double j) const {
    return cellValue(static_cast<std::int64_t>(i), static_cast<std::int64_t>(j), seed_ + 101u * (what + 1u));
  }
  Color color(Draw what, double i, double j, double low, double high) const {
    const auto channel = [&](int c) {
      return static_cast<float>(low + (high - low) * draw(what, 3 * i + c, j));
    };
    return {channel(0), channel(1), channel(2)};
  }

  Color wall() const {
    const double kind = draw(kWall), tone = 0.6 + 0.5 * draw(kWallTone);
    if (kind > 0.66) return stones(0.9, 0.45, Color(0.68f, 0.64f, 0.58f) * tone, 0.7f);
    if (kind > 0.33) return stones(0.36, 0.13, Color(0.6f, 0.33f, 0.26f) * tone, 1.35f);
    return (0.2f * color(kWallTone, 0, 0, 0.3, 1.0) + 0.7f * Color(0.85f, 0.78f, 0.68f)) * tone;
  }
  Color stones(double width, double height, const Color& tone, float joint) const {
    const double row = std::floor(v_ / height);
    const double x = u_ / width + 0.5 * std::fmod(row, 2.0), column = std::floor(x);
    if (std::min((x - column) * width, v_ - row * height) < 0.015) return tone * joint;
    return tone * static_cast<float>(0.8 + 0.35 * draw(kBrick, column, row));
  }

  Appearance window(double sill) const {
    const double width = (0.42 + 0.2 * draw(kWindowWidth)) * cell_, half = 0.5 * width;
    const double height = (0.4 + 0.2 * draw(kWindowHeight)) * storey_, y = y_ - sill, x = x_ + half;
    const double across = std::abs(x_);
    if (across < half && y > 0.0 && y < height) return glazing(x, y, width, height);
    if (across < half + 0.12 && y > -0.1 && y < height + 0.16) return {y < 0.0 ? stone_ * 1.15f : stone_};
    const double shutter = across - half - 0.12;
    if (draw(kShutters) < 0.35 && shutter > 0.0 && shutter < 0.38 * width && y > 0.0 && y < height) {
      const bool slat = std::fmod(y, 0.12) < 0.035 && shutter > 0.04 && shutter < 0.38 * width - 0.04;
      return {color(kShutters, 1, 0, 0.1, 0.6) * (slat ? 0.55f : 1.0f)};
    }
    return {wall()};
  }
  Appearance glazing(double x, double y, double width, double height) const {
    const double across = std::fmod(x / width * (1.0 + std::floor(2.99 * draw(kPanes))), 1.0),
                 up = std::fmod(y / height * (1.0 + std::floor(2.99 * draw(kFrame))), 1.0);
    const double bar = 0.07 / width;
    if (std::min(across, 1.0 - across) < bar || std::min(up, 1.0 - up) < bar)
      return {draw(kFrame) < 0.7 ? grey(0.88) : color(kFrame, 1, 0, 0.1, 0.5)};
    Appearance pane{Color(0.2f, 0.24f, 0.28f) * static_cast<float>(0.4 + draw(kGlass, column_, level_))};
    if (y > height * (0.3 + 1.4 * draw(kBlind, column_, level_))) pane.albedo *= 2.2f;
    const double curtain = draw(kCurtain, column_, level_);
    if (curtain < 0.4 && std::min(x, width - x) < (0.1 + 0.5 * curtain) * width)
      pane.albedo = color(kCurtain, column_, level_, 0.4, 0.9) * (std::fmod(x, 0.1) < 0.05 ? 1.0f : 0.85f);
    if (draw(kLit, column_, level_) < 0.25) pane.glow = pane.albedo * Color(0.09f, 0.07f, 0.04f);
    return pane;
  }

  Appearance groundFloor() const {
    if (y_ < 0.0) return {wall()};
    const bool door = column_ == std::floor(columns_ * draw(kDoor)), shop = draw(kShop) < 0.6;
    if (door && std::abs(x_) < 0.6 && y_ < 2.3) return {doorAt(x_ + 0.6, y_)};
    if (shop && y_ > 2.4 && y_ < 3.0 && u_ > 0.3 && u_ < cell_ * columns_ - 0.3) return sign();
    if (shop && !door && std::abs(x_) < 0.5 * cell_ - 0.06 && y_ > 0.5 && y_ < 2.3) return shopWindow();
    if (y_ < 0.4) return {grey(0.28 + 0.2 * draw(kStone))};
    if (!shop && !door) return window(0.95);
    const double poster = draw(kPoster, column_, 0);
    if (poster < 0.5 && y_ > 0.9 && y_ < 1.9 && std::abs(std::abs(x_) - 0.85) < 0.25) {
      const double ink = draw(kPaper, std::floor(x_ / 0.06), std::floor(y_ / 0.08));
      return {color(kPoster, column_, ink < 0.35, 0.05, 0.95)};
    }
    return {wall()};
  }
  Color doorAt(double x, double y) const {
    const Color paint = color(kDoor, 1, 0, 0.05, 0.55);
    if (x < 0.08 || x > 1.12 || y > 2.2) return stone_;
    if (y > 1.9) return grey(0.15 + 0.2 * std::floor(std::fmod(x, 0.26) / 0.13));
    if (std::abs(x - 1.0) < 0.03 && std::abs(y - 1.05) < 0.08) return grey(0.8);  // handle
    const double panel_x = std::fmod(x + 0.02, 0.52), panel_y = std::fmod(y, 0.62);
    return panel_x > 0.12 && panel_y > 0.14 ? paint * 0.7f : paint;
  }
  // Signs of 4 x 5 dots, as in no alphabet, in a line.
  Appearance sign() const {
    const Color board = color(kShop, 1, 0, 0.05, 0.95);
    const double x = (u_ - 0.45) / 0.42, y = (y_ - 2.48) / 0.09, glyph = std::floor(x);
    const double dot = std::floor((x - glyph) * 5.0), row = std::floor(y);
    const bool inside = dot < 4.0 && row >= 0.0 && row < 5.0 && draw(kGlyph, glyph, -1) < 0.85;
    if (!inside || draw(kGlyph, 8.0 * glyph + dot, row) > 0.55) return {board, board * 0.02f};
    return {grey(board.mean() < 0.5f ? 0.95 : 0.05), grey(board.mean() < 0.5f ? 0.05 : 0.0)};
  }
  Appearance shopWindow() const {
    const double edge = 0.5 * cell_ - 0.06 - std::abs(x_);
    if (edge < 0.07 || y_ < 0.58 || y_ > 2.22) return {color(kShop, 2, 0, 0.1, 0.8)};
    const double i = std::floor(u_ / 0.3), j = std::floor(y_ / 0.36);
    const double x = u_ - 0.3 * i, y = y_ - 0.36 * j, size = 0.1 + 0.18 * draw(kGoods, i, 50 + j);
    Appearance seen{grey(0.12), grey(0.02)};
    if (y < 0.03) seen.albedo = grey(0.4);
    if (x > 0.02 && x < size && y > 0.03 && y < 0.05 + size)
      seen.albedo = color(kGoods, i, j + (y > 0.5 * size ? 100 : 0), 0.05, 0.9);
    return seen;
  }

  std::uint32_t seed_;
  double storey_, u_, v_, columns_, cell_, level_, column_, x_,
      y_;  // m; x from the middle of the column, y above its floor
  Color stone_;
};

}  // namespace

Appearance facadeAt(const Texture& texture, const Eigen::Vector2d& uv) {
  Appearance seen = Facade(texture, uv).seen();
  seen.albedo = seen.albedo.min(1.0f);
  return seen;
}

}  // namespace mapping_simulation
