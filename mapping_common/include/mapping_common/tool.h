// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace mapping_common {

/// Adds the argument --flag that sets an option of a struct, with its default, what it may be and what it is
/// for.
/// @param flag _ is made -
/// @param name of the option
template <class Options>
void addOption(boost::program_options::options_description& arguments, std::string flag, Options& options,
               const std::string& name) {
  namespace po = boost::program_options;
  std::replace(flag.begin(), flag.end(), '_', '-');
  OptionList list = optionsOf(options);
  const Option option = list.find(name)->named("--" + flag);
  arguments.add_options()(
      flag.c_str(),
      po::value<std::string>()->default_value(option.word())->notifier([option](const std::string& word) {
        try {
          Option changed = option;
          changed.parse(word);
          changed.check();
        } catch (const std::invalid_argument& e) {
          throw po::error(e.what());
        }
      }),
      option.help().c_str());
}

/// Parses a tool's command line into the variables of its options, whose names can't be abbreviated. What
/// roslaunch adds (NAME:=VALUE) is left out.
/// @param usage printed before the options where --help asks for them
/// @param unnamed arguments that stand by themselves, in their order; a composing one takes all that are left
/// @return what was given; none where help was printed. @throws boost::program_options::error
inline std::optional<boost::program_options::variables_map> parseArguments(
    std::vector<std::string> words, const std::string& usage,
    const boost::program_options::options_description& options,
    const boost::program_options::options_description& unnamed = {}) {
  namespace po = boost::program_options;
  const auto of_ros = [](const std::string& word) { return word.find(":=") != std::string::npos; };
  words.erase(std::remove_if(words.begin(), words.end(), of_ros), words.end());
  po::positional_options_description positions;
  for (const auto& option : unnamed.options())
    positions.add(option->long_name().c_str(), option->semantic()->is_composing() ? -1 : 1);
  po::options_description all;
  all.add(options).add(unnamed);
  using namespace po::command_line_style;
  po::variables_map values;
  po::store(po::command_line_parser(words)
                .options(all)
                .positional(positions)
                .style(unix_style ^ allow_guessing)
                .run(),
            values);
  if (values.count("help") > 0) {
    std::cout << usage << '\n' << options;
    return std::nullopt;
  }
  po::notify(values);
  return values;
}

inline std::optional<boost::program_options::variables_map> parseArguments(
    int argc, char** argv, const std::string& usage,
    const boost::program_options::options_description& options,
    const boost::program_options::options_description& unnamed = {}) {
  return parseArguments(std::vector<std::string>(argv + 1, argv + argc), usage, options, unnamed);
}

/// The main function of a command-line tool.
/// @param usage printed where the usage is wrong
/// @param parse fills the arguments; false where help was asked for and printed; throws
///   boost::program_options::error or std::invalid_argument for wrong usage
/// @return 0; 1 where something failed, 2 for wrong usage, both said on standard error
template <class Arguments>
int runTool(int argc, char** argv, const std::string& name, const std::string& usage,
            bool (*parse)(int, char**, Arguments&), void (*run)(const Arguments&)) {
  const auto wrong_usage = [&](const std::exception& e) {
    std::cerr << name << ": " << e.what() << "\n\n" << usage << "See " << name << " --help\n";
    return 2;
  };
  Arguments arguments;
  try {
    if (!parse(argc, argv, arguments)) return 0;
  } catch (const boost::program_options::error& e) {
    return wrong_usage(e);
  } catch (const std::invalid_argument& e) {
    return wrong_usage(e);
  } catch (const std::exception& e) {
    std::cerr << name << ": " << e.what() << '\n';
    return 1;
  }
  try {
    run(arguments);
    return 0;
  } catch (const boost::program_options::error& e) {
    return wrong_usage(e);
  } catch (const std::exception& e) {
    std::cerr << '\n' << name << ": " << e.what() << '\n';  // below the progress
    return 1;
  }
}

}  // namespace mapping_common
