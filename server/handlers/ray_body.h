// SPDX-License-Identifier: Apache-2.0
// Receives the body of a batch of rays. The rows of a large array are decoded while they arrive.
#pragma once

#include <cstdint>
#include <optional>

#include "api/ray_table.h"
#include "api/types.h"
#include "server/growing_bytes.h"
#include "server/handler.h"
#include "server/handlers/request_cost.h"
#include "server/request_memory.h"

namespace kdray::server {

/// Arrays are decoded from this size on. Before, a body holds no more memory than its bytes; then
/// it holds whole blocks (BlockPool), at most four times as much.
inline constexpr std::uint64_t kDecodedBytes = std::uint64_t{1} << 20;

struct RayBody {
  RequestMemory::Share share;         ///< of what follows
  GrowingBytes text;                  ///< as received; empty if there are rays
  std::optional<api::RayTable> rays;  ///< of an array that was decoded
  std::uint64_t bytes = 0;            ///< received
  double decode_ms = 0;               ///< rows to rays
};

/// The problems of ReadWholeBody(); invalid_array if a chunked array has not the size that its
/// header says. Arrays of any form that is not decoded here, invalid ones included, come as text.
api::Outcome<RayBody> ReadRayBody(const HandlerContext& context, const RoutedRequest& routed,
                                  const api::RayOptions& options, const WorkOfBody& work);

}  // namespace kdray::server
