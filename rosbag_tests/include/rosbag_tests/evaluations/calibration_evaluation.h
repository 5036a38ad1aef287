// SPDX-License-Identifier: BSD-3-Clause
//
// How well models of intensity tell surfaces apart (thesis, 3.5.1, Fig. 3.4): where samples of surfaces come
// from, and what the reflectivities are worth.
#pragma once

#include <laser_intensity_calib/fit.h>
#include <laser_intensity_calib/incidence.h>
#include <mapping_simulation/sensors.h>
#include <mapping_simulation/trajectory.h>
#include <mapping_simulation/world.h>
#include <rosbag_tests/converters/scan_files.h>

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <map>
#include <string>
#include <vector>

namespace rosbag_tests {

/// Samples by the name of the surface.
using Surfaces = std::map<std::string, std::vector<laser_intensity_calib::Sample>>;

/// A planar scanner, mounted upright, 0.7 m above base_link, which sweeps its plane across the way
/// (push-broom, Fig. 3.8). Surfaces are the world's objects whose names start with "surface".
Surfaces simulateSurfaces(const mapping_simulation::World& world,
                          const mapping_simulation::Trajectory& trajectory,
                          const mapping_simulation::SensorConfig& sensor, std::uint64_t seed,
                          const laser_intensity_calib::CloudIncidenceOptions& options);

/// 3D scans from a vehicle in a street, x ahead and z up. Surfaces are the `road` and the `roadside`, in the
/// plane of the ground up to 2.5 m and from 4.5 to 8 m aside, and the `facades`, what is above the sensor.
/// Lasers are told apart by the order of the points: each turns through all azimuths from 0 on.
/// @param step each step-th scan is used; Sample::scan counts all
/// @param progress is given the number of the scan
Surfaces readStreet(ScanSource& scans, int step, const laser_intensity_calib::CloudIncidenceOptions& options,
                    const std::function<void(int)>& progress = {});

/// Takes the scans of the first part away from all surfaces and fits the models to those of the references.
/// @param part (0, 1), of all scans
/// @param problems gets a sentence for each model left out
/// @throws std::invalid_argument if there is no such surface, or not enough of it
laser_intensity_calib::Calibration trainOnFirstPart(Surfaces& surfaces,
                                                    const std::vector<std::string>& references, double part,
                                                    const laser_intensity_calib::FitOptions& options,
                                                    std::vector<std::string>* problems = nullptr);

/// Reflectivities of a surface by each model; only of samples that all models have a value for. Those of the
/// raw model are without Calibration::offsets.
struct JudgedSurface {
  std::size_t samples = 0;  ///< all, of any value or none
  std::map<laser_intensity_calib::ModelType, std::vector<float>> reflectivities;
};
using JudgedSurfaces = std::map<std::string, JudgedSurface>;

/// @throws std::invalid_argument if the calibration has no table
JudgedSurfaces judge(const laser_intensity_calib::Calibration& calibration, const Surfaces& surfaces);

/// A row for each surface and model: share covered, mean, standard deviation over mean, modes; and a row for
/// each two surfaces: the overlap of their histograms.
void printJudgement(std::ostream& out, const JudgedSurfaces& surfaces);

/// Lines surface,model,reflectivity,share: histograms over 0 to 3.5.
void writeHistograms(const std::string& file, const JudgedSurfaces& surfaces);

}  // namespace rosbag_tests
