// SPDX-License-Identifier: BSD-3-Clause
#include "delaunay.h"

#include <Eigen/LU>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

extern "C" {
#include <libqhull_r/qhull_ra.h>
}

namespace laser_intensity_calib {

std::vector<Triangle> triangulate(const Eigen::Matrix2Xd& points) {
  // Checked here, as Qhull explains a flat input over many lines to stderr.
  Eigen::Matrix2Xd centered = points;
  if (points.cols() > 0) centered.colwise() -= points.rowwise().mean().eval();
  const Eigen::Matrix2d spread = centered * centered.transpose();
  if (points.cols() < 3 || !(spread.determinant() > 1e-12 * spread.trace() * spread.trace())) {
    throw std::invalid_argument(std::to_string(points.cols()) +
                                " points on a line or fewer than 3 can't be triangulated");
  }

  qhT memory;
  qhT* qh = &memory;
  qh_zero(qh, nullptr);
  // d: Delaunay, Qbb: scale the lifted coordinate, Qt: triangles even where more than 3 points share a
  // circle, Qz: a point at infinity, for those that all do.
  std::string command = "qhull d Qbb Qt Qz";
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> log(
      std::tmpfile(), [](std::FILE* file) { return file != nullptr ? std::fclose(file) : 0; });
  const int error = qh_new_qhull(qh, 2, static_cast<int>(points.cols()), const_cast<double*>(points.data()),
                                 0, &command[0], nullptr, log.get());
  std::vector<Triangle> triangles;
  if (error == 0) {
    facetT* facet;
    FORALLfacets {
      if (facet->upperdelaunay || qh_setsize(qh, facet->vertices) != 3) continue;
      Triangle triangle;
      int corner = 0;
      vertexT *vertex, **vertexp;
      FOREACHvertex_(facet->vertices) triangle[corner++] = qh_pointid(qh, vertex->point);
      triangles.push_back(triangle);
    }
  }
  qh_freeqhull(qh, qh_ALL);
  int long_bytes, long_blocks;
  qh_memfreeshort(qh, &long_bytes, &long_blocks);
  if (error != 0)
    throw std::invalid_argument("the triangulation failed, Qhull's error " + std::to_string(error));
  return triangles;
}

}  // namespace laser_intensity_calib
