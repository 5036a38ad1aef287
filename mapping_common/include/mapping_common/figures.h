// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

namespace mapping_common {

/// Has a Python script that is installed beside this program draw what the program has written, and says on
/// standard error where that fails, as it does without matplotlib. The data are there all the same.
/// @param tool this program's name
inline void drawFigures(const std::string& tool, const std::string& script,
                        const std::vector<std::string>& arguments) {
  const std::string path = (std::filesystem::read_symlink("/proc/self/exe").parent_path() / script).string();
  // That of the system has ROS's modules, another on the PATH may not.
  const char* python = std::filesystem::exists("/usr/bin/python3") ? "/usr/bin/python3" : "python3";
  std::vector<std::string> words = {python, path};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(&word[0]);
  argv.push_back(nullptr);
  pid_t child = 0;
  int status = 1;
  const bool started = posix_spawnp(&child, python, nullptr, nullptr, argv.data(), environ) == 0;
  if (started) waitpid(child, &status, 0);
  if (started && status == 0) return;
  std::cerr << tool << ": the data are written, but no figures were drawn; later:";
  for (const std::string& word : words) std::cerr << ' ' << word;
  std::cerr << '\n';
}

}  // namespace mapping_common
