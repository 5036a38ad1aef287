// SPDX-License-Identifier: BSD-3-Clause
//
// How look-up, recall and file scale with the size of a vocabulary. Words are synthetic: some centres, and
// words that differ from them by random bits, as descriptors of one kind of corner do.
#include <boost/program_options.hpp>
#include <chrono>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <random>

#include "ibuild_loop_closure/vocabulary_file.h"

namespace {

using namespace ibuild_loop_closure;
using Clock = std::chrono::steady_clock;

double milliseconds(Clock::time_point since) {
  return std::chrono::duration<double, std::milli>(Clock::now() - since).count();
}

class Words {
 public:
  explicit Words(unsigned seed) : random_(seed), centres_(2000) {
    for (Descriptor& c : centres_) {
      for (auto& bits : c.bits) bits = random_();
    }
  }
  Descriptor next() { return near(centres_[random_() % centres_.size()], 120); }
  Descriptor near(Descriptor word, int bits) {
    for (int i = 0; i < bits; ++i) word.bits[random_() % 8] ^= std::uint64_t{1} << (random_() % 64);
    return word;
  }
  std::size_t below(std::size_t n) { return random_() % n; }

 private:
  std::mt19937_64 random_;
  std::vector<Descriptor> centres_;
};

}  // namespace

int main(int argc, char** argv) {
  namespace po = boost::program_options;
  std::size_t most = 0, words_per_image = 0, old_percent = 0;
  unsigned seed = 0;
  std::string out;
  po::options_description options("Time and recall over the size of the vocabulary.\nOptions");
  options.add_options()("help,h", "this text")("words", po::value(&most)->default_value(1000000),
                                               "of the largest vocabulary")(
      "words-per-image", po::value(&words_per_image)->default_value(150), "")(
      "old", po::value(&old_percent)->default_value(33), "% of an image's words that are in the vocabulary")(
      "seed", po::value(&seed)->default_value(1), "of the synthetic words")(
      "file", po::value(&out)->default_value("/tmp/benchmark.vocabulary"), "written, read and removed");
  po::variables_map values;
  po::store(po::parse_command_line(argc, argv, options), values);
  po::notify(values);
  if (values.count("help") > 0) return std::cout << options, 0;

  Words source(seed);
  Vocabulary vocabulary(70);
  LinearIndex exact(true);
  std::cout << "| Words | Images | Image, mean (ms) | Look-up, tree (us) | exact (us) | Recall (%) "
               "|\n|---|---|---|---|---|---|\n";
  double time = 0.0;
  int images = 0;
  for (std::size_t milestone = 1000; vocabulary.size() < most;) {
    std::vector<Descriptor> words;
    for (std::size_t i = 0; i < words_per_image; ++i) {
      const bool old = vocabulary.size() > 0 && source.below(100) < old_percent;
      words.push_back(old ? source.near(vocabulary.word(source.below(vocabulary.size())), 40)
                          : source.next());
    }
    const auto start = Clock::now();
    const Assignment assignment = vocabulary.assign(words);
    vocabulary.similarities(assignment);
    vocabulary.update(assignment);
    time += milliseconds(start);
    ++images;
    for (std::size_t i = exact.size(); i < vocabulary.size(); ++i) exact.add(vocabulary.word(i));
    if (vocabulary.size() < milestone) continue;

    constexpr int kQueries = 200;
    std::vector<Descriptor> queries;
    for (int i = 0; i < kQueries; ++i)
      queries.push_back(source.near(vocabulary.word(source.below(vocabulary.size())), 40));
    std::vector<FoundWord> by_tree, by_all;
    auto from = Clock::now();
    for (const Descriptor& q : queries) by_tree.push_back(vocabulary.index().find(q, 70));
    const double tree = milliseconds(from);
    from = Clock::now();
    for (const Descriptor& q : queries) by_all.push_back(exact.find(q, 70));
    const double all = milliseconds(from);
    int same = 0, there = 0;
    for (int i = 0; i < kQueries; ++i) {
      there += by_all[i].word >= 0;
      same += by_all[i].word >= 0 && by_tree[i].word == by_all[i].word;
    }
    std::cout << "| " << vocabulary.size() << " | " << vocabulary.images() << " | " << std::fixed
              << std::setprecision(2) << time / images << " | " << 1e3 * tree / kQueries << " | "
              << 1e3 * all / kQueries << " | " << 100.0 * same / std::max(1, there) << " |" << std::endl;
    time = 0.0;
    images = 0;
    milestone *= 10;
  }
  auto from = Clock::now();
  saveVocabulary(out, {vocabulary.content(), {}});
  const double save = milliseconds(from);
  from = Clock::now();
  const Vocabulary loaded = Vocabulary::restore(loadVocabulary(out).content);
  const double load = milliseconds(from);
  std::cout << "\nFile of " << loaded.size() << " words, " << std::filesystem::file_size(out) / 1000000
            << " MB: written in " << save << " ms, loaded in " << load << " ms\n";
  std::filesystem::remove(out);
  return 0;
}
