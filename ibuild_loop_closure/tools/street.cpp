// SPDX-License-Identifier: BSD-3-Clause
#include "street.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ibuild_loop_closure {
namespace {

constexpr double kResolution = 64;   // pixels per m of houses and ground
constexpr double kMaxHeight = 13.0;  // of a house, m

// Draws in m, from the upper left corner; colours are opaque.
class Canvas {
 public:
  Canvas(cv::Mat image, double resolution) : image_(std::move(image)), resolution_(resolution) {}
  double width() const { return image_.cols / resolution_; }
  double height() const { return image_.rows / resolution_; }
  cv::Mat& image() { return image_; }
  Canvas part(double x, double y, double width, double height) const {
    const cv::Rect all({0, 0}, image_.size());
    return {image_(cv::Rect(pixel(x, y), pixel(x + width, y + height)) & all), resolution_};
  }
  void fill(double x, double y, double width, double height, const cv::Scalar& color) {
    cv::rectangle(image_, pixel(x, y), pixel(x + width, y + height) - cv::Point(1, 1), color, cv::FILLED);
  }
  void line(double x1, double y1, double x2, double y2, double width, const cv::Scalar& color) {
    const int thickness = std::max(1, cvRound(width * resolution_));
    cv::line(image_, pixel(x1, y1), pixel(x2, y2), color, thickness, cv::LINE_AA);
  }
  void ellipse(double x, double y, double width, double height, const cv::Scalar& color) {
    const cv::Size axes(cvRound(0.5 * width * resolution_), cvRound(0.5 * height * resolution_));
    cv::ellipse(image_, pixel(x, y), axes, 0, 0, 360, color, cv::FILLED, cv::LINE_AA);
  }
  // As large as fits into the rectangle.
  void text(const std::string& words, double x, double y, double width, double height, int font,
            const cv::Scalar& color) {
    int below = 0;
    const cv::Size unit = cv::getTextSize(words, font, 1.0, 2, &below);
    const double scale = resolution_ * std::min(width / unit.width, height / (unit.height + below));
    const cv::Point centre = pixel(x + 0.5 * width, y + 0.5 * height);
    cv::putText(image_, words,
                centre + cv::Point(cvRound(-0.5 * scale * unit.width), cvRound(0.5 * scale * unit.height)),
                font, scale, color, std::max(1, cvRound(2 * scale)), cv::LINE_AA);
  }

 private:
  cv::Point pixel(double x, double y) const { return {cvRound(x * resolution_), cvRound(y * resolution_)}; }
  cv::Mat image_;
  double resolution_;
};

cv::Scalar grey(double value) {
  return {value, value, value, 255};
}

cv::Scalar shaded(const cv::Scalar& color, double factor) {
  return {std::min(255.0, factor * color[0]), std::min(255.0, factor * color[1]),
          std::min(255.0, factor * color[2]), 255};
}

cv::Scalar anyColor(cv::RNG& random, int low, int high) {
  const int b = random.uniform(low, high), g = random.uniform(low, high), r = random.uniform(low, high);
  return cv::Scalar(b, g, r, 255);
}

bool chance(cv::RNG& random, double probability) {
  return random.uniform(0.0, 1.0) < probability;
}

// Stains of about `size` m and grain of a pixel, where the picture is opaque.
void weather(Canvas canvas, double size, double stains, double grain, cv::RNG& random) {
  cv::Mat& image = canvas.image();
  cv::Mat coarse(std::max(2, cvRound(canvas.height() / size)), std::max(2, cvRound(canvas.width() / size)),
                 CV_32F);
  cv::Mat fine(image.size(), CV_32F), shade;
  random.fill(coarse, cv::RNG::NORMAL, 0.0, stains);
  random.fill(fine, cv::RNG::NORMAL, 0.0, grain);
  cv::resize(coarse, shade, image.size(), 0, 0, cv::INTER_CUBIC);
  shade += fine;
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      cv::Vec4b& pixel = image.at<cv::Vec4b>(v, u);
      for (int c = 0; c < 3 && pixel[3] == 255; ++c)
        pixel[c] = cv::saturate_cast<uchar>(pixel[c] + shade.at<float>(v, u));
    }
  }
}

// Stones of a wall or a pavement, each row displaced by half of one.
void layStones(Canvas& canvas, double width, double height, const cv::Scalar& color, double joint,
               cv::RNG& random) {
  canvas.fill(0, 0, canvas.width(), canvas.height(), shaded(color, joint));
  const double gap = 1.0 / kResolution;
  int row = 0;
  for (double y = 0; y < canvas.height(); y += height, ++row) {
    for (double x = row % 2 ? -0.5 * width : 0.0; x < canvas.width(); x += width)
      canvas.fill(x, y, width - gap, height - gap, shaded(color, random.uniform(0.82, 1.12)));
  }
}

std::string anyWord(cv::RNG& random) {
  static const char* const kSyllables[] = {"BA", "KO",  "MER", "LIN", "TA",  "DOR", "SU", "VEN", "RI",
                                           "ZA", "PEL", "NO",  "GRA", "FEL", "HI",  "US", "ECK", "OL"};
  std::string word;
  const int syllables = random.uniform(2, 4);
  for (int i = 0; i < syllables; ++i) word += kSyllables[random.uniform(0, 18)];
  return word;
}

struct WindowStyle {
  explicit WindowStyle(cv::RNG& random)
      : width(random.uniform(0.8, 1.5)),
        height(random.uniform(1.2, 1.9)),
        panes_across(random.uniform(1, 4)),
        panes_along(random.uniform(1, 4)),
        shutters(chance(random, 0.35)),
        frame(chance(random, 0.7) ? grey(random.uniform(200, 250)) : anyColor(random, 20, 120)),
        shutter(anyColor(random, 30, 160)),
        stone(grey(random.uniform(120, 220))) {}
  double width, height;
  int panes_across, panes_along;
  bool shutters;
  cv::Scalar frame, shutter, stone;
};

void drawShutter(Canvas& canvas, double x, double y, const WindowStyle& style) {
  const double width = 0.4 * style.width;
  canvas.fill(x, y, width, style.height, style.shutter);
  for (double slat = 0.08; slat < style.height; slat += 0.12)
    canvas.line(x + 0.04, y + slat, x + width - 0.04, y + slat, 0.03, shaded(style.shutter, 0.6));
}

// Glass with what is behind it, frame, sill.
void drawWindow(Canvas& canvas, double x, double y, const WindowStyle& style, cv::RNG& random) {
  const double w = style.width, h = style.height;
  canvas.fill(x - 0.12, y - 0.18, w + 0.24, h + 0.2, style.stone);
  const cv::Scalar glass = chance(random, 0.15) ? cv::Scalar(150, 210, 235, 255)
                                                : shaded(cv::Scalar(92, 78, 66), random.uniform(0.5, 1.2));
  canvas.fill(x, y, w, h, glass);
  if (chance(random, 0.5))
    canvas.fill(x, y, w, h * random.uniform(0.15, 0.7), shaded(glass, random.uniform(1.4, 2.4)));  // blind
  if (chance(random, 0.4)) {
    const cv::Scalar curtain = anyColor(random, 130, 240);
    const double side = w * random.uniform(0.1, 0.3);
    canvas.fill(x, y, side, h, curtain);
    canvas.fill(x + w - side, y, side, h, curtain);
  }
  for (int i = 0; i <= style.panes_across; ++i)
    canvas.line(x + w * i / style.panes_across, y, x + w * i / style.panes_across, y + h, 0.06, style.frame);
  for (int i = 0; i <= style.panes_along; ++i)
    canvas.line(x, y + h * i / style.panes_along, x + w, y + h * i / style.panes_along, 0.06, style.frame);
  canvas.fill(x - 0.15, y + h, w + 0.3, 0.1, shaded(style.stone, 1.15));
  if (style.shutters) {
    drawShutter(canvas, x - 0.14 - 0.4 * w, y, style);
    drawShutter(canvas, x + w + 0.14, y, style);
  }
  if (chance(random, 0.2)) {  // flowers
    canvas.fill(x, y + h - 0.15, w, 0.2, cv::Scalar(40, 60, 110, 255));
    for (int i = 0; i < 12; ++i)
      canvas.ellipse(x + random.uniform(0.0, w), y + h - 0.2 + random.uniform(-0.1, 0.1), 0.14, 0.14,
                     chance(random, 0.5) ? cv::Scalar(50, 120, 60, 255) : anyColor(random, 60, 250));
  }
}

void drawDoor(Canvas& canvas, double x, double ground, cv::RNG& random) {
  const cv::Scalar color = anyColor(random, 30, 150);
  canvas.fill(x - 0.15, ground - 2.55, 1.4, 2.55, grey(random.uniform(130, 220)));
  canvas.fill(x, ground - 2.4, 1.1, 2.4, color);
  canvas.fill(x + 0.05, ground - 2.35, 1.0, 0.3, cv::Scalar(120, 110, 90, 255));
  for (int i = 0; i < 4; ++i)
    canvas.fill(x + 0.12 + 0.48 * (i % 2), ground - 1.9 + 0.95 * (i / 2), 0.38, 0.75, shaded(color, 0.65));
  canvas.ellipse(x + 1.0, ground - 1.05, 0.08, 0.08, grey(220));
  canvas.fill(x + 1.4, ground - 2.0, 0.4, 0.3, cv::Scalar(120, 50, 20, 255));
  canvas.text(std::to_string(random.uniform(1, 200)), x + 1.42, ground - 1.98, 0.36, 0.26,
              cv::FONT_HERSHEY_DUPLEX, grey(245));
}

// A shop window with goods on shelves, and its sign.
void drawShop(Canvas& canvas, double x, double width, double ground, cv::RNG& random) {
  static const int kFonts[] = {cv::FONT_HERSHEY_DUPLEX, cv::FONT_HERSHEY_COMPLEX, cv::FONT_HERSHEY_TRIPLEX,
                               cv::FONT_HERSHEY_SCRIPT_COMPLEX};
  const cv::Scalar paint = anyColor(random, 20, 200);
  canvas.fill(x, ground - 2.5, width, 2.5, shaded(paint, 0.8));
  canvas.fill(x + 0.15, ground - 2.35, width - 0.3, 1.8, cv::Scalar(88, 84, 76, 255));
  for (double shelf = ground - 1.75; shelf < ground - 0.5; shelf += 0.58) {
    for (double item = x + 0.2; item < x + width - 0.6;) {
      const double w = random.uniform(0.1, 0.35), h = random.uniform(0.15, 0.45);
      canvas.fill(item, shelf - h, w, h, anyColor(random, 30, 240));
      item += w + random.uniform(0.02, 0.3);
    }
    canvas.line(x + 0.15, shelf, x + width - 0.15, shelf, 0.04, shaded(paint, 0.5));
  }
  canvas.line(x + 0.5 * width, ground - 2.35, x + 0.5 * width, ground - 0.55, 0.08, shaded(paint, 0.8));
  const bool dark = paint[0] + paint[1] + paint[2] < 330;
  canvas.fill(x, ground - 3.2, width, 0.65, paint);
  canvas.text(anyWord(random) + (chance(random, 0.4) ? " & " + anyWord(random) : ""), x + 0.15, ground - 3.12,
              width - 0.3, 0.48, kFonts[random.uniform(0, 4)], grey(dark ? 240 : 15));
}

void drawHouse(Canvas canvas, cv::RNG& random) {
  constexpr double kGroundFloor = 3.4, kFloor = 3.0;
  const double w = canvas.width(), h = canvas.height();
  const int kind = random.uniform(0, 3);
  if (kind == 0)
    layStones(canvas, 0.36, 0.13, shaded(cv::Scalar(70, 88, 165), random.uniform(0.6, 1.1)), 1.25, random);
  else if (kind == 1)
    layStones(canvas, 0.9, 0.45, shaded(cv::Scalar(150, 165, 175), random.uniform(0.8, 1.1)), 0.7, random);
  else
    canvas.fill(0, 0, w, h,
                0.25 * anyColor(random, 100, 250) +
                    0.75 * shaded(cv::Scalar(170, 200, 215), random.uniform(0.7, 1.1)));
  const WindowStyle style(random);
  const double spacing =
      style.width + (style.shutters ? 0.8 * style.width + 0.4 : 0.3) + random.uniform(0.3, 0.9);
  const int columns = std::max(1, static_cast<int>((w - 0.4) / spacing));
  for (double y = h - kGroundFloor - kFloor; y > 0.2; y -= kFloor) {
    canvas.fill(0, y + kFloor - 0.1, w, 0.12, style.stone);
    for (int i = 0; i < columns; ++i)
      drawWindow(canvas, 0.5 * (w - columns * spacing) + (i + 0.5) * spacing - 0.5 * style.width, y + 0.6,
                 style, random);
  }
  const double door = chance(random, 0.5) ? 0.4 : w - 2.3;
  drawDoor(canvas, door, h, random);
  const double left = door < 1 ? 2.5 : 0.3, width = w - 2.9;
  if (chance(random, 0.6)) {
    drawShop(canvas, left, width, h, random);
  } else {
    for (double x = left + 0.5; x + style.width < left + width; x += spacing)
      drawWindow(canvas, x, h - 1.0 - style.height, style, random);
  }
  if (chance(random, 0.3)) {  // poster
    const cv::Scalar paper = anyColor(random, 120, 250);
    const double x = random.uniform(0.3, w - 1.0);
    canvas.fill(x, h - 2.0, 0.7, 1.0, paper);
    canvas.text(anyWord(random), x + 0.04, h - 1.95, 0.62, 0.3, cv::FONT_HERSHEY_DUPLEX, shaded(paper, 0.2));
    canvas.ellipse(x + 0.35, h - 1.35, 0.45, 0.45, anyColor(random, 20, 220));
  }
  canvas.fill(0, 0, w, 0.35, shaded(style.stone, 0.9));  // cornice
  for (double x = 0.1; x < w; x += 0.4) canvas.fill(x, 0.2, 0.2, 0.15, shaded(style.stone, 0.6));
  canvas.line(0.1, 0.3, 0.1, h, 0.1, grey(80));  // drainpipe
  canvas.fill(0, h - 0.4, w, 0.4, grey(random.uniform(70, 130)));
}

std::shared_ptr<const Texture> houseFronts(double width, cv::RNG& random) {
  Canvas row(cv::Mat::zeros(cvRound(kMaxHeight * kResolution), cvRound(width * kResolution), CV_8UC4),
             kResolution);
  constexpr double kNarrowest = 5.5;
  for (double x = 0; x < width;) {
    double house = random.uniform(kNarrowest, 11.0);
    if (width - x - house < kNarrowest) house = width - x;
    const double height = 3.6 + 3.0 * random.uniform(1, 4) + random.uniform(-0.2, 0.3);
    drawHouse(row.part(x, kMaxHeight - height, house, height), random);
    x += house;
  }
  weather(row, 0.6, 7, 4, random);
  return std::make_shared<Texture>(row.image(), kResolution);
}

std::shared_ptr<const Texture> ground(double length, cv::RNG& random) {
  const double width = kStreetLeft - kStreetRight, pavement = 2.0;
  Canvas canvas(cv::Mat(cvRound(width * kResolution), cvRound(length * kResolution), CV_8UC4, grey(98)),
                kResolution);
  for (int i = 0; i < length / 3; ++i) {  // where the road was opened and mended
    canvas.fill(random.uniform(0.0, length), random.uniform(pavement, width - pavement - 1),
                random.uniform(0.5, 5.0), random.uniform(0.4, 1.5), grey(random.uniform(70, 120)));
  }
  for (int i = 0; i < length; ++i) {  // cracks
    double x = random.uniform(0.0, length), y = random.uniform(pavement, width - pavement);
    for (int k = 0; k < 8; ++k) {
      const double to_x = x + random.uniform(-0.1, 0.5), to_y = y + random.uniform(-0.3, 0.3);
      canvas.line(x, y, to_x, to_y, 0.02, grey(55));
      x = to_x;
      y = to_y;
    }
  }
  for (double x = 0.5; x < length; x += 6.0) canvas.fill(x, 0.5 * width - 0.06, 3.0, 0.12, grey(215));
  for (int i = 0; i < length / 8; ++i) {  // manholes
    const double x = random.uniform(0.0, length), y = random.uniform(pavement + 0.6, width - pavement - 0.6);
    canvas.ellipse(x, y, 0.7, 0.7, grey(60));
    for (double line = -0.2; line < 0.25; line += 0.1)
      canvas.line(x - 0.25, y + line, x + 0.25, y + line, 0.03, grey(105));
  }
  for (double y : {0.0, width - pavement}) {
    Canvas side = canvas.part(0, y, length, pavement);
    layStones(side, 0.6, 0.5, grey(150), 0.6, random);
    side.fill(0, y > 0 ? 0.0 : pavement - 0.2, length, 0.2, grey(185));  // kerb
  }
  weather(canvas, 0.8, 6, 6, random);
  return std::make_shared<Texture>(canvas.image(), kResolution);
}

}  // namespace

std::vector<Surface> makeStreet(double length, cv::RNG& random) {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(),
                        z = Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d left(0, kStreetLeft, 0), right(0, kStreetRight, 0), top(0, 0, kMaxHeight);
  std::vector<Surface> street;
  street.push_back({left + top, x, -z, houseFronts(length, random)});
  street.push_back({right + top + length * x, -x, -z, houseFronts(length, random)});
  street.push_back({left, x, -y, ground(length, random)});
  street.push_back({left + top + length * x, -y, -z, houseFronts(kStreetLeft - kStreetRight, random)});
  return street;
}

Surface makePerson(double x, double y, cv::RNG& random) {
  constexpr double kWidth = 0.7, kPersonResolution = 150;
  const double height = random.uniform(1.55, 1.9), middle = 0.5 * kWidth;
  Canvas canvas(
      cv::Mat::zeros(cvRound(height * kPersonResolution), cvRound(kWidth * kPersonResolution), CV_8UC4),
      kPersonResolution);
  const cv::Scalar coat = anyColor(random, 20, 220), trousers = anyColor(random, 20, 110),
                   skin(140, 170, 215, 255);
  const double stride = random.uniform(0.0, 0.15);
  canvas.line(middle - 0.05, 0.85, middle - 0.08 - stride, height - 0.05, 0.15, trousers);
  canvas.line(middle + 0.05, 0.85, middle + 0.08 + stride, height - 0.05, 0.15, trousers);
  canvas.line(middle - 0.22, 0.38, middle - 0.27, 0.9, 0.1, shaded(coat, 0.8));
  canvas.line(middle + 0.22, 0.38, middle + 0.27, 0.9, 0.1, shaded(coat, 0.8));
  canvas.fill(middle - 0.23, 0.3, 0.46, 0.65, coat);
  for (double stripe = 0.35; stripe < 0.9; stripe += 0.12)
    canvas.fill(middle - 0.23, stripe, 0.46, 0.05, anyColor(random, 20, 240));
  canvas.ellipse(middle, 0.15, 0.2, 0.28, skin);
  canvas.ellipse(middle, 0.09, 0.22, 0.16, anyColor(random, 10, 120));
  weather(canvas, 0.1, 10, 4, random);
  return {{x, y + middle, height},
          -Eigen::Vector3d::UnitY(),
          -Eigen::Vector3d::UnitZ(),
          std::make_shared<Texture>(canvas.image(), kPersonResolution)};
}

}  // namespace ibuild_loop_closure
