// SPDX-License-Identifier: Apache-2.0
#include "core/base/fp_environment.h"

#include <limits>

namespace kdray::core {
namespace {

// Each value passes through a volatile, so the processor computes it, not the compiler.

template <class T>
bool FlushesToZero() {
  const volatile T smallest = std::numeric_limits<T>::min();
  const volatile T half = smallest * T{0.5};
  return half == T{0};
}

template <class T>
bool ReadsDenormalsAsZero() {
  const volatile T denormal = std::numeric_limits<T>::denorm_min();
  const volatile T scale = T{1} / std::numeric_limits<T>::epsilon();
  const volatile T product = denormal * scale;
  return product == T{0};
}

/// 1 plus half an ulp, and 1 plus slightly more than half an ulp. Rounding to nearest gives 1 and
/// its successor. Rounding up changes the first result, rounding down or towards zero the second;
/// for negative numbers it is the reverse.
template <class T>
bool RoundsToNearest() {
  const volatile T one = T{1};
  const volatile T half = std::numeric_limits<T>::epsilon() / 2;
  const volatile T more = half * T{1.5};
  const volatile T up = one + half;
  const volatile T down = -one - half;
  const volatile T next = one + more;
  const volatile T previous = -one - more;
  return up == one && down == -one && next > one && previous < -one;
}

Error Refusal(const char* what) {
  return Error{.code = ErrorCode::kInternal,
               .message = std::string("floating-point results would differ: ") + what};
}

}  // namespace

Status CheckFloatingPointEnvironment() {
  if (FlushesToZero<float>() || FlushesToZero<double>()) {
    return Refusal("denormal results are flushed to zero");
  }
  if (ReadsDenormalsAsZero<float>() || ReadsDenormalsAsZero<double>()) {
    return Refusal("denormal operands are read as zero");
  }
  if (!RoundsToNearest<float>() || !RoundsToNearest<double>()) {
    return Refusal("rounding is not to nearest");
  }
  return {};
}

}  // namespace kdray::core
