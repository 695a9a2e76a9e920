// SPDX-License-Identifier: Apache-2.0
// The JSON text of a glTF file as values of the JSON library, for core/io/gltf_document.cc.
#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"

namespace kdray::core {

/// The library's destructors allocate memory for a value's children, and a failure there would end
/// the process. So this one destroys the children first, the innermost before the others.
struct GltfJson {
  explicit GltfJson(nlohmann::json parsed) : json(std::move(parsed)) {}
  GltfJson(GltfJson&&) = default;
  GltfJson& operator=(GltfJson&&) = delete;
  ~GltfJson();

  nlohmann::json json;
  std::vector<std::string_view> uris;  ///< of "data:#0", "data:#1" …; views into the text
};

/// Parses the text twice: first it counts the values and finds where the text is not JSON, then it
/// makes them. `on_bytes` is called between the two. Parameters and errors: see ReadGltfDocument.
Result<GltfJson> ParseGltfJson(std::string_view text, std::uint64_t first_byte, CancelPoll* poll,
                               const std::function<Status(std::uint64_t)>& on_bytes);

}  // namespace kdray::core
