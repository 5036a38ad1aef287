// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <mapping_common/options.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cstring>
#include <exception>
#include <iostream>
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

/// The main function of a command-line tool. What roslaunch adds to the command line (NAME:=VALUE) is left
/// out.
/// @param usage printed where the usage is wrong
/// @param parse fills the arguments; false where help was asked for and printed; throws
///   boost::program_options::error or std::invalid_argument for wrong usage
/// @return 0; 1 where something failed, 2 for wrong usage, both said on standard error
template <class Arguments>
int runTool(int argc, char** argv, const std::string& name, const std::string& usage,
            bool (*parse)(int, char**, Arguments&), void (*run)(const Arguments&)) {
  std::vector<char*> words;
  for (int i = 0; i < argc; ++i) {
    if (std::strstr(argv[i], ":=") == nullptr) words.push_back(argv[i]);
  }
  const auto wrong_usage = [&](const std::exception& e) {
    std::cerr << name << ": " << e.what() << "\n\n" << usage << "See " << name << " --help\n";
    return 2;
  };
  Arguments arguments;
  try {
    if (!parse(static_cast<int>(words.size()), words.data(), arguments)) return 0;
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
