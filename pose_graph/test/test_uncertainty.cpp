// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <vector>

#include "../src/uncertainty.h"
#include "graphs.h"
#include "pose_graph/optimisation.h"

namespace pose_graph {
namespace {

class Uncertainties : public testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    optimise(graph_);
    for (std::size_t e = 0; e < graph_.edges().size(); ++e)
      if (graph_.edges()[e].type != EdgeType::kConsecutive) loops_.push_back(e);
  }
  // chi2 at the optimum without and with some loops.
  double gainOf(const std::vector<std::size_t>& loops) {
    Graph without = graph_, with = graph_;
    for (const std::size_t e : loops) without.setActive(e, false), with.setActive(e, true);
    optimise(without);
    optimise(with);
    return with.chi2() - without.chi2();
  }
  Graph graph_ = rounds(GetParam(), 30, 10, 0.01, 3);
  std::vector<std::size_t> loops_;
};
INSTANTIATE_TEST_SUITE_P(All, Uncertainties, testing::Bool());

// What a loop adds to chi2 is the square of its error over the error's covariance, the loop being in the
// graph or not.
TEST_P(Uncertainties, TellWhatLoopsAddToChi2) {
  const std::vector<std::size_t> several = {loops_[0], loops_[3], loops_[4]};
  for (const std::vector<std::size_t>& some : {std::vector<std::size_t>{loops_[2]}, several}) {
    const double expected = gainOf(some);
    ASSERT_GT(expected, 0.1);
    {
      Uncertainty with(graph_);
      const Uncertainty::Errors errors = with.errors(some);
      EXPECT_NEAR(expected, errors.errors.dot(errors.covariance.ldlt().solve(errors.errors)),
                  0.02 * expected);
    }
    Graph graph = graph_;
    for (const std::size_t e : some) graph.setActive(e, false);
    optimise(graph);
    Uncertainty without(graph);
    const Uncertainty::Errors errors = without.errors(some);
    EXPECT_NEAR(expected, errors.errors.dot(errors.covariance.ldlt().solve(errors.errors)), 0.02 * expected);
  }
}

// One call for many says the same as one for each.
TEST_P(Uncertainties, OfSeveralAreThoseOfEach) {
  Uncertainty uncertainty(graph_);
  const auto all = uncertainty.errors(loops_);
  const Eigen::Index n = graph_.dimension();
  for (std::size_t i = 0; i < loops_.size(); ++i) {
    const auto one = uncertainty.errors({loops_[i]});
    const Eigen::Index row = n * static_cast<Eigen::Index>(i);
    EXPECT_TRUE(one.covariance.isApprox(all.covariance.block(row, row, n, n), 1e-9));
    EXPECT_TRUE(one.errors.isApprox(all.errors.segment(row, n)));
  }
}

TEST_P(Uncertainties, ArePoorBetweenParts) {
  for (std::size_t e = 0; e < graph_.edges().size(); ++e)
    if (graph_.edges()[e].to == 15 || graph_.edges()[e].type != EdgeType::kConsecutive)
      graph_.setActive(e, false);
  Uncertainty uncertainty(graph_);  // of a loop from 7 to 17
  EXPECT_GT(uncertainty.errors({loops_[7]}).covariance.diagonal().minCoeff(), 1e6);
}

}  // namespace
}  // namespace pose_graph
