// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/program_options/errors.hpp>
#include <exception>
#include <iostream>
#include <string>

namespace mapping_common {

/// The main function of a command-line tool.
/// @param parse fills the arguments; false where help was asked for and printed; throws
///   boost::program_options::error for wrong usage
/// @return 0; 1 where something failed, 2 for wrong usage, both said on standard error
template <class Arguments>
int runTool(int argc, char** argv, const std::string& name, const std::string& usage,
            bool (*parse)(int, char**, Arguments&), void (*run)(const Arguments&)) {
  try {
    Arguments arguments;
    if (parse(argc, argv, arguments)) run(arguments);
    return 0;
  } catch (const boost::program_options::error& e) {
    std::cerr << name << ": " << e.what() << "\n\n" << usage << "See " << name << " --help\n";
    return 2;
  } catch (const std::exception& e) {
    std::cerr << '\n' << name << ": " << e.what() << '\n';  // below the progress
    return 1;
  }
}

}  // namespace mapping_common
