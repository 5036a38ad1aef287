// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mapping_common {

/// How much longer than usual a test may have to wait: sanitizers slow down what they watch.
#if defined(__SANITIZE_THREAD__)
constexpr double kSlowness = 10.0;
#elif defined(__SANITIZE_ADDRESS__)
constexpr double kSlowness = 3.0;
#else
constexpr double kSlowness = 1.0;
#endif

}  // namespace mapping_common
