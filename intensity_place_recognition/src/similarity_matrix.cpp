// SPDX-License-Identifier: BSD-3-Clause
#include "intensity_place_recognition/similarity_matrix.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace intensity_place_recognition {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

// Of each row that of itself; 0 where nothing is known, or all are alike.
SimilarityMatrix normalized(const SimilarityMatrix& matrix) {
  SimilarityMatrix result = SimilarityMatrix::Zero(matrix.rows(), matrix.cols());
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    double count = 0.0, sum = 0.0, squares = 0.0;
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
      const double value = matrix(i, j);
      if (i == j || std::isnan(value)) continue;
      ++count;
      sum += value;
      squares += value * value;
    }
    const double mean = sum / count, deviation = std::sqrt(squares / count - mean * mean);
    if (!(deviation > 1e-9 * std::abs(mean))) continue;
    for (Eigen::Index j = 0; j < matrix.cols(); ++j)
      if (!std::isnan(matrix(i, j))) result(i, j) = static_cast<float>((matrix(i, j) - mean) / deviation);
  }
  return result;
}

}  // namespace

SimilarityMatrix fused(const std::vector<SimilarityMatrix>& all) {
  SimilarityMatrix sum = SimilarityMatrix::Zero(all.front().rows(), all.front().cols());
  Eigen::ArrayXXi known = Eigen::ArrayXXi::Zero(sum.rows(), sum.cols());
  for (const SimilarityMatrix& matrix : all) {
    const SimilarityMatrix of_rows = normalized(matrix);
    sum += (0.5f * (of_rows + of_rows.transpose())).cwiseMax(0.0f).cwiseAbs2();
    known += matrix.array().isNaN().select(Eigen::ArrayXXi::Zero(sum.rows(), sum.cols()), 1);
  }
  return (known > 0).select(sum.cwiseSqrt(), kUnknown);
}

SimilarityMatrix confirmed(const SimilarityMatrix& global, const SimilarityMatrix& local, int count) {
  SimilarityMatrix result = SimilarityMatrix::Constant(global.rows(), global.cols(), kUnknown);
  for (Eigen::Index i = 0; i < global.rows(); ++i) {
    std::vector<std::pair<float, Eigen::Index>> others;
    for (Eigen::Index j = 0; j < global.cols(); ++j)
      if (i != j && !std::isnan(global(i, j))) others.emplace_back(-global(i, j), j);
    std::sort(others.begin(), others.end());
    for (std::size_t k = 0; k < others.size() && k < static_cast<std::size_t>(count); ++k) {
      const Eigen::Index j = others[k].second;
      result(i, j) = result(j, i) = local(i, j);
    }
  }
  return result;
}

}  // namespace intensity_place_recognition
