// SPDX-License-Identifier: BSD-3-Clause
#include "mapping_common/map_image.h"

#include <iomanip>
#include <ostream>
#include <stdexcept>

#include "mapping_common/files.h"

namespace mapping_common {

void writeMapImage(const std::string& path, const MapImage& image) {
  if (image.pixels.size() != static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height))
    throw std::logic_error("an image's size and its pixels don't agree");
  const std::string stem = path.substr(0, path.rfind('.')), file = stem.substr(stem.rfind('/') + 1) + ".pgm";
  writeFile(stem + ".pgm", [&](std::ostream& out) {
    out << "P5\n" << image.width << ' ' << image.height << "\n255\n";
    out.write(reinterpret_cast<const char*>(image.pixels.data()),
              static_cast<std::streamsize>(image.pixels.size()));
  });
  const bool plain =
      file.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-") ==
      std::string::npos;
  std::string quoted = "'";
  for (const char c : file) quoted += c == '\'' ? "''" : std::string(1, c);
  writeFile(stem + ".yaml", [&](std::ostream& out) {
    out << std::setprecision(12) << "image: " << (plain ? file : quoted + '\'')
        << "\nresolution: " << image.resolution << "\norigin: [" << image.origin_x << ", " << image.origin_y
        << ", 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
  });
}

}  // namespace mapping_common
