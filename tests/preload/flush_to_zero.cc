// SPDX-License-Identifier: Apache-2.0
// A library that does to the process that loads it what some others do by accident: numbers too
// small for full precision become 0. Put into kdrayd with LD_PRELOAD (N22).
#include <xmmintrin.h>

namespace {

constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040;

[[gnu::constructor]] void FlushToZero() {
  _mm_setcsr(_mm_getcsr() | kFlushToZero | kDenormalsAreZero);
}

}  // namespace
