// SPDX-License-Identifier: BSD-3-Clause
//
// Fits the models to observations of the reference surface, and tells how well they do and what is missing.
#pragma once

#include <laser_intensity_calib/models.h>

#include <functional>
#include <string>
#include <vector>

namespace laser_intensity_calib {

/// One beam on the reference surface.
struct Sample {
  float range;      ///< m
  float incidence;  ///< rad
  float intensity;  ///< as the scanner gives it
  int scan;         ///< number of its scan, from 0
  int laser = 0;    ///< number of its laser, from 0, where a scanner has several
};

struct FitOptions {
  double range_cell = 0.1, incidence_cell = 2.0 * M_PI / 180.0;
  int min_samples = 5;
  double max_edge = 0.0;
  double range_step = 0.05, incidence_step = 1.0 * M_PI / 180.0;
  double normal_incidence = 15.0 * M_PI / 180.0;
  int max_degree = 8;
  int folds = 5;
  bool offsets = false;

  void describe(mapping_common::OptionList& o) {
    o("range_cell", range_cell, "m", "samples are summed up in cells of this size").within(0.001, 100.0);
    o("incidence_cell", incidence_cell, "deg", "and this").within(0.1, 90.0).inDegrees();
    o("min_samples", min_samples, "", "of a cell; those with fewer are left out").within(1, 1000000);
    o("max_edge", max_edge, "cells", "wider gaps aren't interpolated across; 0: all are").within(0.0, 1e6);
    o("range_step", range_step, "m", "of the table").within(0.001, 100.0);
    o("incidence_step", incidence_step, "deg", "of the table").within(0.05, 45.0).inDegrees();
    o("normal_incidence", normal_incidence, "deg", "up to which the range model is fitted")
        .within(0.1, 90.0)
        .inDegrees();
    o("max_degree", max_degree, "", "of the range model's polynomial; the best by cross-validation is taken")
        .within(0, 20);
    o("folds", folds, "", "of the cross-validation").within(2, 100);
    o("offsets", offsets, "", "of a cloud with the field ring: fit what each laser adds to its intensities");
  }
};

/// What the samples of a cell of range and angle come to.
struct Cell {
  double range, incidence, intensity;  ///< m, rad: means; median
  double spread;                       ///< of the intensity: 1.48 median absolute deviations
  int samples;
};

/// Cells with enough samples, sorted by range, then angle. Samples that aren't finite, or whose range or
/// intensity isn't positive, are left out.
std::vector<Cell> sumUp(const std::vector<Sample>& samples, const FitOptions& options);

/// Least squares over the medians of intensity at near normal incidence.
/// @throws std::invalid_argument if there are too few samples, or the result isn't positive
RangePolynomial fitPolynomial(const std::vector<Sample>& samples, int degree, const FitOptions& options);

/// Delaunay triangulation over (r, alpha), linear inside of the triangles, sampled at the nodes of a table.
/// As f doesn't depend on the side that the beam comes from, f(r, -alpha) = f(r, alpha) closes it at alpha =
/// 0.
/// @throws std::invalid_argument if the cells are on a line
LookupTable fitTable(const std::vector<Cell>& cells, const FitOptions& options);

/// What each laser adds to the intensity, I = rho f(r, alpha) + o: what its samples differ, on the average,
/// from those of all lasers in the same cells. Lasers that see the reference at one range and angle each
/// (level ground) get what differs from their neighbours; what changes slowly with r and alpha stays in f.
/// @return one for each laser, their mean is 0; NaN for those with fewer than 10 min_samples samples
/// @throws std::invalid_argument if there is one laser only
std::vector<float> fitOffsets(const std::vector<Sample>& samples, const FitOptions& options);

/// All three models, of all samples; residuals by cross-validation, which leaves out whole runs of scans. A
/// model that the samples don't support is left out, unless it is both the polynomial and the table.
/// @param problems gets a sentence for a model left out
/// @param progress is given the share done, [0, 1]
/// @throws std::invalid_argument that says what is missing
Calibration calibrate(const std::vector<Sample>& samples, const FitOptions& options,
                      std::vector<std::string>* problems = nullptr,
                      const std::function<void(double)>& progress = {});

/// Of the samples in `samples` that the model covers.
Residuals residualsOf(const Calibration& calibration, ModelType type, const std::vector<Sample>& samples);

/// Ranges and angles that a table interpolates across without samples.
struct Coverage {
  double observed = 0.0;            ///< share of the cells inside of the table that have enough samples
  std::vector<std::string> advice;  ///< sentences: what is thin, and where to look
  std::string map;                  ///< text, rows of angles over columns of ranges
};
Coverage coverageOf(const std::vector<Cell>& cells, const LookupTable& table, const FitOptions& options);

}  // namespace laser_intensity_calib
