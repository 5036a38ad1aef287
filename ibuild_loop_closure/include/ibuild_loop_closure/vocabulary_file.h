// SPDX-License-Identifier: BSD-3-Clause
//
// Vocabulary files are archives (mapping_common/archive.h) of delta and the index's options, the words, the
// words of each image, the index's links and the features of each image.
#pragma once

#include <string>
#include <vector>

#include "ibuild_loop_closure/geometry.h"
#include "ibuild_loop_closure/vocabulary.h"

namespace ibuild_loop_closure {

struct VocabularyFile {
  Vocabulary::Content content;
  std::vector<View> views;  ///< one for each image, or none
};

/// Writes a temporary file beside `path` and renames it. @throws std::runtime_error with the reason
void saveVocabulary(const std::string& path, const VocabularyFile& file);

/// @throws std::runtime_error that names the file and says what is wrong with it: foreign, another version,
/// truncated, corrupted, inconsistent
VocabularyFile loadVocabulary(const std::string& path);

}  // namespace ibuild_loop_closure
