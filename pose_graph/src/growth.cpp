// SPDX-License-Identifier: BSD-3-Clause
#include "growth.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "consistency.h"
#include "uncertainty.h"

namespace pose_graph {
namespace {

using Loops = std::vector<std::size_t>;

constexpr std::size_t kBatch = 32;
constexpr int kResort = 4;                // batches with news, after which the order is looked at again ...
constexpr std::size_t kSoon = 256;        // ... of so many loops: they get surer alike
constexpr std::size_t kMostInGroup = 30;  // larger groups of neighbours are judged one by one alone
constexpr int kRounds = 5;                // of dropping what others contradict
// Loops that fit better than their information says are held to how well they do, but for this factor.
constexpr double kSlack = 6.0, kLeastScale = 0.01;
constexpr std::size_t kEnoughForScale = 20;
constexpr std::size_t kMostDoubted = 20;  // groups
constexpr double kOdds = 20.0;            // of a right loop against a wrong one

class Growth {
 public:
  Growth(Graph& graph, const Loops& loops, const LoopCheckOptions& options, const Progress& progress)
      : graph_(graph), loops_(loops), options_(options), progress_(progress) {}

  OptimisationResult run() {
    for (const std::size_t e : loops_) graph_.setActive(e, false);
    solve();
    Loops left = loops_;
    // Strictly at first, so that hardly any wrong one gets in as long as little is known; then what was right
    // but unlucky; at last what stays.
    const Pass passes[] = {{0.9, true}, {0.99, true}, {0.999, false}, {options_.confidence, true}};
    for (const Pass& pass : passes) {
      pass_ = pass;
      acceptFrom(std::exchange(left, {}));
      left = refused_;
    }
    for (int round = 0; round < kRounds && doubt(); ++round) {
    }
    return optimise(graph_, options_.optimisation, progress_);
  }

 private:
  struct Pass {
    double confidence = 0.0;
    bool must_be_likelier = false;
  };

  // Of chi2 of so many loops together.
  double most(std::size_t loops) const {
    return scale_ * quantileOfChi2(static_cast<int>(loops) * graph_.dimension(), pass_.confidence);
  }
  double mostOfEach() const { return std::max(most(1), scale_ * options_.threshold(graph_.dimension())); }

  void solve() {
    OptimisationOptions options = options_.optimisation;
    options.tolerance = std::max(options.tolerance, 1e-6);
    optimise(graph_, options, progress_);
    Eigen::Array3d low = graph_.nodes()[0].pose.translation, high = low;
    for (const Node& node : graph_.nodes()) {
      low = low.min(node.pose.translation.array());
      high = high.max(node.pose.translation.array());
    }
    extent_ = (high - low).max(1.0);
  }

  // By the volume of the covariance of their errors.
  Loops surestFirst(const Loops& loops) const {
    Uncertainty uncertainty(graph_);
    std::vector<std::pair<double, std::size_t>> volumes;
    for (const std::size_t e : loops) {
      volumes.emplace_back(logDeterminant(uncertainty.errors({e}).covariance), e);
    }
    std::stable_sort(volumes.begin(), volumes.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    Loops sorted;
    for (const auto& [volume, e] : volumes) sorted.push_back(e);
    return sorted;
  }

  // Loops that aren't in the graph, the surest first; leaves in refused_ those that still aren't.
  void acceptFrom(Loops left) {
    refused_.clear();
    left = surestFirst(left);
    for (int news = 0; !left.empty();) {
      const auto last = left.begin() + static_cast<std::ptrdiff_t>(std::min(kBatch, left.size()));
      news += accept({left.begin(), last}) ? 1 : 0;
      left.erase(left.begin(), last);
      if (news < kResort || left.empty()) continue;
      news = 0;
      dropContradicted();
      const auto soon = left.begin() + static_cast<std::ptrdiff_t>(std::min(kSoon, left.size()));
      const Loops sorted = surestFirst({left.begin(), soon});
      std::copy(sorted.begin(), sorted.end(), left.begin());
    }
    dropContradicted();
  }

  // Tries it without those groups without which least is known: a wrong one that was the first in its part of
  // the map may have kept out right ones. What tells is truncated least squares, the sum of chi2, and of the
  // most that a right loop may have for each that is left out.
  // @return whether one went
  bool doubt() {
    Uncertainty uncertainty(graph_);
    std::vector<std::pair<double, Loops>> groups;
    for (Loops& group : groupsOf(graph_, active())) {
      const double volume = gain(uncertainty, group).log_covariance;
      if (group.size() <= kMostInGroup) groups.emplace_back(-volume, std::move(group));
    }
    std::stable_sort(groups.begin(), groups.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    groups.resize(std::min({groups.size(), kMostDoubted, static_cast<std::size_t>(options_.max_doubts)}));
    const auto cost = [&] {
      return graph_.chi2() + most(1) * static_cast<double>(loops_.size() - active().size());
    };
    const Graph before = graph_;
    const Loops refused = refused_;
    const double cost_before = cost();
    for (const auto& [volume, group] : groups) {
      for (const std::size_t e : group) graph_.setActive(e, false);
      solve();
      Uncertainty without(graph_);
      Loops fitting;
      for (const std::size_t e : refused)
        if (squared(without.errors({e})) <= most(1)) fitting.push_back(e);
      if (fitting.size() > group.size()) {
        Loops left = refused;
        left.insert(left.end(), group.begin(), group.end());
        acceptFrom(left);
        if (cost() < cost_before - most(1)) return true;
      }
      graph_ = before;
      refused_ = refused;
    }
    return false;
  }

  Loops active() const {
    Loops active;
    for (const std::size_t e : loops_)
      if (graph_.edges()[e].active) active.push_back(e);
    return active;
  }

  // Those that fit what is known, and each other.
  // @return whether there are any
  bool accept(const Loops& batch) {
    const Loops fitting = fittingOf(batch);
    for (const std::size_t e : fitting) graph_.setActive(e, true);
    for (const std::size_t e : batch)
      if (!graph_.edges()[e].active) refused_.push_back(e);
    if (fitting.empty()) return false;
    solve();
    dropWorst();
    return true;
  }

  Loops fittingOf(const Loops& batch) const {
    const Uncertainty::Errors known = Uncertainty(graph_).errors(batch);
    const int n = graph_.dimension();
    const auto chi2 = [&](const Loops& some) {  // of their errors together
      const auto size = static_cast<Eigen::Index>(some.size());
      Uncertainty::Errors part{Eigen::VectorXd(n * size), Eigen::MatrixXd(n * size, n * size)};
      for (Eigen::Index i = 0; i < size; ++i) {
        const auto row = n * static_cast<Eigen::Index>(some[static_cast<std::size_t>(i)]);
        part.errors.segment(n * i, n) = known.errors.segment(row, n);
        for (Eigen::Index j = 0; j < size; ++j) {
          const auto column = n * static_cast<Eigen::Index>(some[static_cast<std::size_t>(j)]);
          part.covariance.block(n * i, n * j, n, n) = known.covariance.block(row, column, n, n);
        }
      }
      return squared(part);
    };
    Loops fitting;
    for (std::size_t i = 0; i < batch.size(); ++i)
      if (chi2({i}) <= most(1)) fitting.push_back(i);
    // As long as nothing was wrong, nothing that fits is suspected.
    if (pass_.must_be_likelier && (!refused_.empty() || fitting.size() < batch.size())) {
      const auto is_chance = [&](std::size_t i) {
        const auto row = n * static_cast<Eigen::Index>(i);
        return !isLikely(batch[i], chi2({i}), logDeterminant(known.covariance.block(row, row, n, n)));
      };
      fitting.erase(std::remove_if(fitting.begin(), fitting.end(), is_chance), fitting.end());
    }
    Agreement agreement(fitting.size());
    for (std::size_t i = 0; i < fitting.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        if (chi2({fitting[i], fitting[j]}) <= most(2)) agreement.set(i, j);
    Loops agreeing;
    for (const std::size_t i : agreement.largeClique()) agreeing.push_back(batch[fitting[i]]);
    return agreeing;
  }

  // Whether an error is likelier of a right loop, by kOdds, than of a wrong one, which may have any error
  // that has room in the map: N(error; 0, S) > kOdds / volume. Where little is known, S is large, and wrong
  // ones fit by chance.
  // @param log_covariance logarithm of the determinant of the error's covariance, whitened by the loop's
  // information
  bool isLikely(std::size_t loop, double chi2, double log_covariance) const {
    const int n = graph_.dimension();
    // Directions that the loop doesn't measure are as uncertain as the map is large.
    const double least_turn = 12.0 / std::pow(2.0 * M_PI, 2);
    Eigen::MatrixXd information(n, n);
    double volume = 0.0;
    const Matrix6& all = graph_.edges()[loop].information;
    if (graph_.planar()) {
      static const int kRows[] = {0, 1, 5};
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) information(r, c) = all(kRows[r], kRows[c]);
      information.diagonal().array() +=
          Eigen::Array3d(12.0 / (extent_.x() * extent_.x()), 12.0 / (extent_.y() * extent_.y()), least_turn);
      volume = extent_.x() * extent_.y() * 2.0 * M_PI;
    } else {
      information = all;
      information.diagonal().head<3>().array() += 12.0 / extent_.square();
      information.diagonal().tail<3>().array() += least_turn;
      volume = extent_.prod() * 8.0 * M_PI * M_PI;
    }
    const double log_determinant = log_covariance - logDeterminant(information);
    return chi2 / scale_ + n * std::log(2.0 * M_PI * scale_) + log_determinant + 2.0 * std::log(kOdds) <=
           2.0 * std::log(volume);
  }
  // Of a covariance or information, which rounding may have made slightly negative.
  static double logDeterminant(const Eigen::MatrixXd& m) {
    return m.ldlt().vectorD().array().max(1e-12).log().sum();
  }
  static double squared(const Uncertainty::Errors& e) {
    return e.errors.dot(e.covariance.ldlt().solve(e.errors));
  }

  // As long as there are loops that don't fit where the poses are now: the error above was a linear one.
  void dropWorst() {
    for (;;) {
      double worst = mostOfEach();
      for (const std::size_t e : loops_)
        if (graph_.edges()[e].active) worst = std::max(worst, graph_.chi2(e));
      if (worst <= mostOfEach()) return;
      for (const std::size_t e : loops_)
        if (graph_.edges()[e].active && graph_.chi2(e) > std::max(mostOfEach(), 0.5 * worst)) drop(e);
      solve();
    }
  }

  void drop(std::size_t e) {
    graph_.setActive(e, false);
    refused_.push_back(e);
  }

  // Those without which chi2 would be less by more than a right one's.
  void dropContradicted() {
    for (int round = 0; round < kRounds; ++round) {
      Uncertainty uncertainty(graph_);
      std::vector<double> gains(graph_.edges().size(), 0.0), all;
      std::vector<bool> by_chance(graph_.edges().size(), false);
      for (const std::size_t e : active()) {
        const Gain without = gain(uncertainty, {e});
        all.push_back(gains[e] = without.chi2);
        by_chance[e] =
            pass_.must_be_likelier && !refused_.empty() && !isLikely(e, without.chi2, without.log_covariance);
      }
      estimateScale(all);
      Loops contradicted;
      for (const Loops& group : groupsOf(graph_, active())) {
        const bool as_one = group.size() > 1 && group.size() <= kMostInGroup &&
                            gain(uncertainty, group).chi2 > most(group.size());
        for (const std::size_t e : group)
          if (as_one || by_chance[e] || gains[e] > most(1)) contradicted.push_back(e);
      }
      if (contradicted.empty()) return;
      for (const std::size_t e : contradicted) drop(e);
      solve();
    }
  }

  // What chi2 is more with some loops, and the logarithm of the determinant of their errors' covariance
  // without them, whitened by their information.
  struct Gain {
    double chi2, log_covariance;
  };
  static Gain gain(Uncertainty& uncertainty, const Loops& some) {
    const Uncertainty::Errors errors = uncertainty.errors(some);
    return {squared(errors), -logDeterminant(errors.covariance)};
  }

  // By a quantile that is high enough to tell of heavy tails, and that few wrong ones hardly move.
  void estimateScale(std::vector<double> chi2) {
    if (chi2.size() < kEnoughForScale) return;
    constexpr double kShare = 0.9;
    const auto at = chi2.begin() + static_cast<std::ptrdiff_t>(kShare * static_cast<double>(chi2.size()));
    std::nth_element(chi2.begin(), at, chi2.end());
    scale_ = std::clamp(kSlack * *at / quantileOfChi2(graph_.dimension(), kShare), kLeastScale, 1.0);
  }

  Graph& graph_;
  const Loops& loops_;
  const LoopCheckOptions& options_;
  const Progress& progress_;
  Pass pass_;
  double scale_ = 1.0;
  Eigen::Array3d extent_;  // of the map, m
  Loops refused_;
};

}  // namespace

OptimisationResult grow(Graph& graph, const std::vector<std::size_t>& loops, const LoopCheckOptions& options,
                        const Progress& progress) {
  if (loops.empty()) return optimise(graph, options.optimisation, progress);
  return Growth(graph, loops, options, progress).run();
}

}  // namespace pose_graph
