// SPDX-License-Identifier: Apache-2.0
// The limits of this server. Set by the command line; GET /v1 lists them under these names.
#pragma once

#include <cstddef>
#include <cstdint>

namespace kdray::api {

// The same for every server.
inline constexpr std::int64_t kMaxWholeSide =
    1 << 20;  ///< of a whole image, pixels; Limits bounds the part that one answer renders
inline constexpr std::int64_t kMaxDepth = 255;  ///< of cells; no tree is deeper
inline constexpr std::int64_t kMaxPage = 1000;  ///< trees
inline constexpr std::size_t kMaxLights = 64;   ///< of a render
inline constexpr std::int64_t kMaxHits = 1024;  ///< of a row of `all`

struct Limits {
  std::uint64_t max_upload_bytes = std::uint64_t{1} << 30;  ///< mesh_too_large
  std::uint64_t max_rays = 4'000'000;                       ///< too_many_rays
  std::uint64_t max_pixels = 67'108'864;  ///< image_too_large, together with max_image_side
  std::uint64_t max_image_side = 16'384;
  std::uint64_t max_cells = 100'000;         ///< too_many_cells: lists
  std::uint64_t max_picture_cells = 16'384;  ///< too_many_cells: cells that cells_depth draws
  std::uint64_t max_samples = 1024;
  std::uint64_t max_deadline_ms = 600'000;
  std::uint64_t max_wait_ms = 60'000;
  std::uint64_t max_json_body_bytes = 1 << 20;  ///< body_too_large: renders
  std::uint64_t max_json_depth = 32;

  /// too_many_hits: the hits of one answer of `all`.
  std::uint64_t MaxAnswerHits() const { return 16 * max_rays; }

  /// A JSON batch: every number written in full (25 bytes) in rows of eight.
  std::uint64_t MaxBatchBytes() const { return 4096 + max_rays * 8 * 25; }
};

}  // namespace kdray::api
