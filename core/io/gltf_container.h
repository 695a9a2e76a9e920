// SPDX-License-Identifier: Apache-2.0
// The container of a glTF 2.0 file: GLB, or its JSON as text.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"

namespace kdray::core {

/// The parts of a file, as views of its bytes.
struct GltfContainer {
  bool is_glb = false;
  std::string_view json;
  std::uint64_t json_begin = 0;  ///< in the file
  std::optional<std::span<const std::byte>> binary;
};

/// Finds the parts. The text of a file that is not GLB is all JSON, without the padding after it.
/// Errors: kInvalidMesh with the byte of the container, or those of the poll.
Result<GltfContainer> OpenGltf(std::span<const std::byte> bytes, CancelPoll* poll);

/// Whether the bytes begin as a GLB file, or as a JSON object, which glTF is. O(1).
bool IsGlb(std::string_view bytes);
bool BeginsAsJsonObject(std::string_view bytes);

}  // namespace kdray::core
