// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// Before a function: compiled for processors with AVX2, too, and chosen when the program starts. It computes
// the same to the bit. Sanitizers don't know what chooses.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define INTENSITY_PLACE_RECOGNITION_VECTORISED __attribute__((target_clones("avx2", "default")))
#else
#define INTENSITY_PLACE_RECOGNITION_VECTORISED
#endif
