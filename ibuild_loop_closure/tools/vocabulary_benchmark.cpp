// SPDX-License-Identifier: BSD-3-Clause
//
// How look-up, recall, insertion and file scale with the size of a vocabulary, on synthetic words.
#include <mapping_common/tool.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <ctime>
#include <filesystem>
#include <iomanip>
#include <iostream>

#include "ibuild_loop_closure/vocabulary_file.h"
#include "synthetic_words.h"

namespace {

using namespace ibuild_loop_closure;
constexpr int kDelta = 70;
constexpr int kQueries = 500;

// Of the processor, not of the wall: other programs don't count.
double microseconds(std::clock_t since) {
  return 1e6 * static_cast<double>(std::clock() - since) / CLOCKS_PER_SEC;
}

// Mean time of a look-up, us.
double timeOf(const WordIndex& index, const std::vector<Descriptor>& queries, std::vector<FoundWord>& found) {
  found.clear();
  const auto start = std::clock();
  for (const Descriptor& q : queries) found.push_back(index.find(q, kDelta));
  return microseconds(start) / static_cast<double>(std::max<std::size_t>(1, queries.size()));
}

struct Steps {
  double assign = 0.0, similarities = 0.0, update = 0.0;  // us
  std::size_t images = 0, words = 0, added = 0;
};

void report(const Vocabulary& vocabulary, const LinearIndex& exact, const std::vector<Descriptor>& queries,
            const Steps& steps) {
  std::vector<FoundWord> nearest, found;
  const double time_exact = timeOf(exact, queries, nearest);
  std::vector<Descriptor> with, without;
  for (std::size_t i = 0; i < queries.size(); ++i)
    (nearest[i].word >= 0 ? with : without).push_back(queries[i]);
  const double time_without = timeOf(vocabulary.index(), without, found);
  const double time_with = timeOf(vocabulary.index(), with, found);
  nearest.erase(std::remove_if(nearest.begin(), nearest.end(), [](const FoundWord& f) { return f.word < 0; }),
                nearest.end());
  int any = 0, same = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    any += found[i].word >= 0;
    same += found[i].distance == nearest[i].distance;
  }
  const double images = static_cast<double>(steps.images);
  std::cout << "| " << vocabulary.size() << " | " << vocabulary.images() << std::fixed << std::setprecision(1)
            << " | " << time_with << " | " << time_without << " | " << time_exact << " | "
            << 100.0 * any / static_cast<double>(with.size()) << " | "
            << 100.0 * same / static_cast<double>(with.size()) << " | "
            << steps.update / static_cast<double>(steps.added) << " | "
            << static_cast<double>(steps.added) / images << " of "
            << static_cast<double>(steps.words) / images << std::setprecision(2) << " | "
            << 1e-3 * steps.assign / images << " | " << 1e-3 * steps.similarities / images << " | "
            << 1e-3 * steps.update / images << " |" << std::endl;
}

struct Arguments {
  std::size_t most = 1000000, words_per_image = 150, old_percent = 33;
  unsigned seed = 1;
  int numbers = 16;
  std::string file = "/tmp/benchmark.vocabulary";
  IndexOptions index;
};

const char kUsage[] =
    "Usage: vocabulary_benchmark [options]\n\nTime and recall over the size of the vocabulary.\n";

bool parse(int argc, char** argv, Arguments& a) {
  namespace po = boost::program_options;
  const auto with_default = [](auto* value) { return po::value(value)->default_value(*value); };
  po::options_description options("Options");
  // clang-format off
  options.add_options()
      ("help,h", "this text")
      ("words", with_default(&a.most), "of the largest vocabulary")
      ("words-per-image", with_default(&a.words_per_image), "")
      ("old", with_default(&a.old_percent), "% of an image's words that were seen before")
      ("numbers", with_default(&a.numbers), "that a patch has: more make its words differ more")
      ("seed", with_default(&a.seed), "of the synthetic words")
      ("file", with_default(&a.file), "written, read and removed");
  // clang-format on
  for (const char* name : {"links", "insert_breadth", "search_breadth"})
    mapping_common::addOption(options, name, a.index, name);
  return mapping_common::parseArguments(argc, argv, kUsage, options).has_value();
}

void run(const Arguments& a) {
  SyntheticWords source(a.seed, a.numbers);
  std::vector<SyntheticWords::Patch> seen;
  const auto next = [&] {
    const bool old = !seen.empty() && source.below(100) < a.old_percent;
    return old ? source.again(seen[source.below(seen.size())]) : source.patch();
  };
  Vocabulary vocabulary(kDelta, a.index);
  LinearIndex exact(true);
  std::cout
      << "| words | images | look-up, there (us) | not there (us) | exact (us) | found (%) | the nearest (%) "
         "| "
         "insertion (us) | new words of an image | assignment (ms) | similarities (ms) | update (ms) |\n"
         "|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  Steps steps;
  for (std::size_t milestone = 1000; vocabulary.size() < a.most;) {
    std::vector<Descriptor> words;
    for (std::size_t i = 0; i < a.words_per_image; ++i) {
      const SyntheticWords::Patch patch = next();
      seen.push_back(patch);
      words.push_back(source.word(patch));
    }
    auto start = std::clock();
    const Assignment assignment = vocabulary.assign(words);
    steps.assign += microseconds(start);
    start = std::clock();
    vocabulary.idfSimilarities(assignment);
    steps.similarities += microseconds(start);
    start = std::clock();
    vocabulary.update(assignment);
    steps.update += microseconds(start);
    ++steps.images;
    steps.words += words.size();
    steps.added += assignment.new_words.size();
    for (std::size_t i = exact.size(); i < vocabulary.size(); ++i) exact.add(vocabulary.word(i));
    if (vocabulary.size() < milestone) continue;

    std::vector<Descriptor> queries;
    for (int i = 0; i < kQueries; ++i) {
      queries.push_back(
          source.word(i % 2 == 0 ? source.again(seen[source.below(seen.size())]) : source.patch()));
    }
    report(vocabulary, exact, queries, steps);
    steps = {};
    milestone *= 10;
  }
  auto from = std::clock();
  saveVocabulary(a.file, {VocabularyFile().descriptor, vocabulary.content(), {}});
  const double save = 1e-3 * microseconds(from);
  from = std::clock();
  const Vocabulary loaded = Vocabulary::restore(loadVocabulary(a.file).content);
  const double load = 1e-3 * microseconds(from);
  std::cout << "\nFile of " << loaded.size() << " words, " << std::filesystem::file_size(a.file) / 1000000
            << " MB: written in " << save << " ms, loaded in " << load << " ms\n";
  std::filesystem::remove(a.file);
}

}  // namespace

int main(int argc, char** argv) {
  return mapping_common::runTool(argc, argv, "vocabulary_benchmark", kUsage, parse, run);
}
