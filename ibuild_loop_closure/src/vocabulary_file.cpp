// SPDX-License-Identifier: BSD-3-Clause
#include "ibuild_loop_closure/vocabulary_file.h"

#include <mapping_common/archive.h>

#include <stdexcept>

namespace ibuild_loop_closure {
namespace {

using mapping_common::ArchiveReader;
using mapping_common::ArchiveWriter;

constexpr mapping_common::ArchiveFormat kFormat = {"IBUILDVC", "a vocabulary of this package", 2, 3};

// Version 2 has the index's type as a number, and all options in this order.
void readOptions2(ArchiveReader& read, Vocabulary::Content& content) {
  IndexOptions& index = content.index;
  read(content.delta);
  index.type = static_cast<IndexType>(read.next<std::int32_t>());
  if (mapping_common::nameOf(index.type).empty())
    throw std::runtime_error("it has an index of an unknown type");
  index.nearest = read.next<std::int32_t>() != 0;
  read(index.links);
  read(index.insert_breadth);
  read(index.search_breadth);
}

View readView(ArchiveReader& read) {
  View view;
  read(view.size.width);
  read(view.size.height);
  read(view.features.points);
  read(view.features.descriptors);
  read(view.depths);
  const std::size_t count = view.features.descriptors.size();
  if (view.features.points.size() != count || (!view.depths.empty() && view.depths.size() != count))
    throw std::runtime_error("it has an image whose features are incomplete");
  return view;
}

}  // namespace

void saveVocabulary(const std::string& path, const VocabularyFile& file) {
  mapping_common::writeArchive(path, kFormat, [&file](ArchiveWriter& write) {
    VocabularyFile options;
    options.descriptor = file.descriptor;
    options.content.delta = file.content.delta;
    options.content.index = file.content.index;
    write(mapping_common::optionsOf(options));
    write(file.content.words);
    write(static_cast<std::uint64_t>(file.content.image_words.size()));
    for (const std::vector<int>& words : file.content.image_words) write(words);
    write(file.content.links);
    write(static_cast<std::uint64_t>(file.views.size()));
    for (const View& view : file.views) {
      write(view.size.width);
      write(view.size.height);
      write(view.features.points);
      write(view.features.descriptors);
      write(view.depths);
    }
  });
}

VocabularyFile loadVocabulary(const std::string& path) {
  VocabularyFile file;
  mapping_common::readArchive(path, kFormat, [&file](ArchiveReader& read) {
    Vocabulary::Content& content = file.content;
    if (read.version() == 2) {
      readOptions2(read, content);
    } else {
      read(mapping_common::optionsOf(file));
    }
    mapping_common::optionsOf(file).check();
    read(content.words);
    content.image_words.resize(read.count(sizeof(std::uint64_t)));
    for (std::vector<int>& words : content.image_words) read(words);
    read(content.links);
    const std::size_t views = read.count(sizeof(std::uint64_t));
    if (views != 0 && views != content.image_words.size())
      throw std::runtime_error("it has features of some images only");
    file.views.reserve(views);
    for (std::size_t i = 0; i < views; ++i) file.views.push_back(readView(read));
  });
  return file;
}

}  // namespace ibuild_loop_closure
