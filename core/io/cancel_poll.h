// Looking at a cancel token from a loop whose steps take nanoseconds.
#pragma once

#include <cstdint>
#include <utility>

#include "core/base/cancel.h"

namespace kdray::core {

/// Asks the token, which reads the clock, once in 4096 calls: some 0.1 ms of parsing.
class CancelPoll {
 public:
  explicit CancelPoll(CancelToken token) : token_(std::move(token)) {}

  bool ShouldStop() { return ++calls_ % 4096 == 0 && token_.ShouldStop(); }
  Error ToError() const { return token_.ToError(); }

 private:
  CancelToken token_;
  std::uint32_t calls_ = 0;
};

}  // namespace kdray::core
