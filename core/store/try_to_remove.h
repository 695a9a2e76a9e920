// SPDX-License-Identifier: Apache-2.0
// Removal of files where no error can be reported.
#pragma once

namespace kdray::core {

/// Calls remove() until it does not throw, but not for ever. What may be missing is the memory for
/// the name of a file, and often only for a moment. After the last try the file stays, as after a
/// failure of the disk.
template <class Remove>
void TryToRemove(const Remove& remove) noexcept {
  constexpr int kTries = 4;
  for (int i = 0; i < kTries; ++i) {
    try {
      return remove();
    } catch (...) {
    }
  }
}

}  // namespace kdray::core
