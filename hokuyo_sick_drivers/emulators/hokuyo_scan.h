// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "hokuyo_model.h"
#include "scan_source.h"
#include "transmitter.h"

namespace device_emulators {

/// What a measuring command asks for.
struct HokuyoRequest {
  std::string echo, user_text;  ///< the request up to its count digits; what follows them
  int first = 0, last = 0, cluster = 1;
  int interval = 0, count = 0;  ///< continuous commands
  bool continuous = false;      ///< M., N.: streams; G., H.: once
  bool intensity = false;       ///< .E
  bool multi_echo = false;      ///< H., N.
  bool two_characters = false;  ///< .S
};

/// Measured values as the device codes them. @param partial_group whether steps left over from whole clusters
/// make a value too
SentScan measure(const Scan* scan, const HokuyoModel& model, const HokuyoRequest& request,
                 bool partial_group);
/// Characters of the data rows, not yet cut into rows.
std::string encodeScan(const SentScan& scan, const HokuyoRequest& request);

}  // namespace device_emulators
