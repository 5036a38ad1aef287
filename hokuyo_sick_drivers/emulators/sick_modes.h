// SPDX-License-Identifier: BSD-3-Clause
//
// Codes of the LMS's commands and operating modes.
#pragma once

#include <string>

namespace device_emulators {

enum SickCommand : unsigned char {
  kReset = 0x10,
  kChangeMode = 0x20,
  kAskScan = 0x30,
  kAskStatus = 0x31,
  kAskErrors = 0x32,
  kAskMeans = 0x36,
  kAskSubrange = 0x37,
  kAskType = 0x3a,
  kChangeVariant = 0x3b,
  kAskMeansOfSubrange = 0x3f,
  kAskReflectivities = 0x44,
  kAskConfiguration = 0x74,
  kAskIntensities = 0x75,
  kWriteConfiguration = 0x77,
};

enum SickMode : unsigned {
  kInstallation = 0x00,
  kDiagnosis = 0x10,
  kStreamAll = 0x24,
  kOnRequest = 0x25,
  kStreamMeans = 0x26,
  kStreamSubrange = 0x27,
  kStreamMeansOfSubrange = 0x28,
  kStreamPartial = 0x2a,
  kStreamIntensities = 0x2b,
  kBaud38400 = 0x40,
  kBaud19200 = 0x41,
  kBaud9600 = 0x42,
  kBaud500000 = 0x48,
  kStreamReflectivities = 0x50,
};

/// The 20 characters that 3Ah is answered with.
inline std::string paddedType(std::string type) {
  type.resize(20, ' ');
  return type;
}

}  // namespace device_emulators
