// SPDX-License-Identifier: BSD-3-Clause
//
// Numbers for what the thesis shows as histograms of reflectivity (Fig. 3.4). Values that aren't finite are
// left out.
#pragma once

#include <cstddef>
#include <vector>

namespace laser_intensity_calib {

/// Standard deviation over mean; NaN for fewer than 2 values.
double coefficientOfVariation(const std::vector<float>& values);

/// Shares of the values in `bins` equal bins from min to max; the outer bins hold what is beyond.
std::vector<double> histogram(const std::vector<float>& values, double min, double max, std::size_t bins);

/// Area that the histograms of two samples share, 0: apart, 1: the same. Bins are those of Freedman and
/// Diaconis for the two together, over all but the outermost 0.5 % of values on each side. NaN for fewer than
/// 2 values of either.
double overlap(const std::vector<float>& a, const std::vector<float>& b);

/// Number of local maxima of the kernel density estimate (Gaussian, Silverman's bandwidth
/// 0.9 min(sigma, IQR / 1.34) n^-1/5) that rise at least a tenth of the highest above the dips to higher
/// ones.
int modes(const std::vector<float>& values);

}  // namespace laser_intensity_calib
