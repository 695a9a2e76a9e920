// SPDX-License-Identifier: Apache-2.0
// The memory of one batch: its body, its rows, and its answer until it is sent.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>

#include "api/batch_work.h"
#include "server/request_memory.h"

namespace kdray::server {

/// Begins with the share of the body, and takes more of the budget when rows and answer need it.
/// Returned bytes are first used again by the same batch. For one thread at a time.
class BatchMemory {
 public:
  /// `too_large` is the code for a batch that can never fit beside the `tree_bytes` of its tree.
  BatchMemory(RequestMemory::Share body, api::ErrorCode too_large, std::uint64_t tree_bytes)
      : share_(std::move(body)), used_(share_.bytes()), too_large_(too_large) {
    share_.KeepsOfLender(tree_bytes);
  }

  /// `too_large`, or memory_full if the budget does not have what is missing.
  api::Check Charge(std::uint64_t bytes) {
    if (used_ + bytes > share_.bytes()) {
      if (auto problem = share_.Grow(used_ + bytes - share_.bytes(), too_large_)) return problem;
    }
    used_ += bytes;
    return std::nullopt;
  }
  api::ChargeBytes charge() {
    return [this](std::uint64_t bytes) { return Charge(bytes); };
  }
  /// These bytes are free.
  void Return(std::uint64_t bytes) { used_ -= bytes; }

  /// A handle that holds `bytes` of the budget, the rest is returned.
  std::shared_ptr<const void> Keep(std::uint64_t bytes) && {
    share_.ShrinkTo(bytes);
    return std::make_shared<const RequestMemory::Share>(std::move(share_));
  }

 private:
  RequestMemory::Share share_;
  std::uint64_t used_;
  const api::ErrorCode too_large_;
};

}  // namespace kdray::server
