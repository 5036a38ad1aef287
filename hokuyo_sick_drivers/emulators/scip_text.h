// SPDX-License-Identifier: BSD-3-Clause
//
// How SCIP 2 writes lines and numbers, on the device's side.
#pragma once

#include <cstdint>
#include <string>

namespace device_emulators {

/// Sum character of a line: low six bits of the sum of its bytes, plus 30h.
char scipSum(const std::string& line);
/// A number in characters of six bits, the highest first, each plus 30h.
std::string scipEncode(std::uint32_t value, int characters);
/// Line, sum, LF.
std::string scipLine(const std::string& line);
/// "KEY:value;", sum, LF. @param sum_semicolon whether the semicolon counts, as in some firmware
std::string scipKeyLine(const std::string& key, const std::string& value, bool sum_semicolon);
/// Rows of 64 characters and a rest, each with its sum.
std::string scipRows(const std::string& data);
/// A whole reply: echo, status, contents (lines that are complete), empty line.
std::string scipReply(const std::string& echo, const std::string& status, const std::string& contents = "");

}  // namespace device_emulators
