#include "core/base/fp_environment.h"

#include <limits>

namespace kdray::core {
namespace {

// Each value passes through a volatile, so that the processor computes it and not the compiler.

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

/// Half a unit in the last place of 1, and a little more: to nearest they round to 1 and to its
/// successor. Upwards the first fails, downwards and towards zero the second; on the negative side
/// it is the other way round.
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
