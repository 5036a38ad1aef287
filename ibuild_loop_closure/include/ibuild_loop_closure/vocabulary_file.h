// SPDX-License-Identifier: BSD-3-Clause
//
// Vocabulary files are archives (mapping_common/archive.h) of the kind of descriptors, delta and the index's
// options, the words, the words of each image, the index's links and the features of each image.
#pragma once

#include <string>
#include <vector>

#include "ibuild_loop_closure/geometry.h"
#include "ibuild_loop_closure/vocabulary.h"

namespace ibuild_loop_closure {

struct VocabularyFile {
  std::string descriptor = "brisk";  ///< see FeatureOptions; files that don't say have no other
  Vocabulary::Content content;
  std::vector<View> views;  ///< one for each image, or none

  void describe(mapping_common::OptionList& o) {
    o("descriptor", descriptor, "", "of the words").oneOf(descriptors());
    content.describe(o);
  }
};

/// Writes a temporary file beside `path` and renames it. @throws std::runtime_error with the reason
void saveVocabulary(const std::string& path, const VocabularyFile& file);

/// @throws std::runtime_error that names the file and says what is wrong with it: foreign, another version,
/// truncated, corrupted, inconsistent
VocabularyFile loadVocabulary(const std::string& path);

}  // namespace ibuild_loop_closure
