// SPDX-License-Identifier: Apache-2.0
// The numbers of a glTF file: its buffers, views and accessors, checked against each other.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/io/gltf_document.h"

namespace kdray::core {

/// What an accessor is used for, which limits its types.
enum class GltfUse : std::uint8_t { kPosition, kNormal, kUv, kColor, kIndices };

/// One element; missing components are 0. Indices are in [0].
using GltfElement = std::array<double, 4>;

/// For one thread at a time.
class GltfAccessors {
 public:
  /// `binary`: the GLB's BIN chunk; nullopt without one. `file_bytes` bounds the elements of an
  /// accessor whose values are all zero. All must outlive this.
  GltfAccessors(const GltfDocument& document, std::optional<std::span<const std::byte>> binary,
                std::uint64_t file_bytes, CancelPoll* poll);

  /// Whether the accessor has a legal type for its use, and all its elements lie in its views and
  /// buffers. Its buffers will be decoded. kInvalidMesh with the JSON pointer.
  Status Check(std::uint64_t accessor, GltfUse use);
  /// Of an accessor that passed Check.
  std::uint64_t CountOf(std::uint64_t accessor) const {
    return document_.accessors[accessor].count;
  }

  /// The memory that Decode takes, at most.
  std::uint64_t DecodedBytes() const;
  /// Decodes the buffers that checked accessors use. kInvalidMesh if one is not valid base64, or is
  /// shorter than it claims, and positions or indices are in it; the accessors of another such
  /// buffer no longer pass Check. Those of the poll.
  Status Decode();

  /// Calls visit(i, element) for each element in order, then again for those that sparse values
  /// replace. False when the poll has stopped, or a sparse index is too large: then error() says
  /// where.
  template <class Visit>
  bool ForEach(std::uint64_t number, const Visit& visit) {
    const GltfAccessor& accessor = document_.accessors[number];
    constexpr std::uint64_t kElementWork = 64;
    const Elements elements = ElementsOf(accessor);
    const bool all = PolledLoop(accessor.count, kElementWork, poll_,
                                [&](std::size_t i) { visit(i, elements.Get(i)); });
    if (!all || !accessor.sparse) return all;
    const auto [indices, values] = SparseOf(accessor);
    for (std::uint64_t k = 0; k < accessor.sparse->count; ++k) {
      if (poll_->Spend(kElementWork)) return false;
      const auto i = static_cast<std::uint64_t>(indices.Get(k)[0]);
      if (i >= accessor.count) return FailSparse(number, i);
      visit(static_cast<std::size_t>(i), values.Get(k));
    }
    return true;
  }
  const Error& error() const { return error_; }

 private:
  // Elements in the bytes of a view.
  struct Elements {
    const std::byte* first = nullptr;  // null: all zero
    std::uint64_t stride = 0;
    GltfType type = GltfType::kFloat;
    int components = 1;
    bool normalized = false;

    GltfElement Get(std::uint64_t i) const;
  };
  struct Sparse {
    Elements indices;
    Elements values;
  };

  // What is checked, for its errors.
  struct Checked {
    std::string pointer;
    bool is_needed = false;  // the mesh is invalid without it
  };
  Status CheckElements(std::uint64_t view, std::uint64_t offset, std::uint64_t count,
                       std::uint64_t element_bytes, const Checked& checked);
  Status CheckView(std::uint64_t number, const Checked& checked);
  Status UseBuffer(std::uint64_t number, bool is_needed);
  Status DecodeBuffer(std::uint64_t number);
  std::span<const std::byte> ViewBytes(std::uint64_t view) const;
  Elements ElementsOf(const GltfAccessor& accessor) const;
  Sparse SparseOf(const GltfAccessor& accessor) const;
  bool FailSparse(std::uint64_t accessor, std::uint64_t index);

  struct Buffer {
    bool is_used = false;
    bool is_needed = false;
    bool is_broken = false;  // found when it was decoded
    std::span<const std::byte> bytes;
    std::vector<std::byte> decoded;
  };

  const GltfDocument& document_;
  std::optional<std::span<const std::byte>> binary_;
  std::uint64_t file_bytes_;
  CancelPoll* poll_;
  std::vector<Buffer> buffers_;
  Error error_;
};

}  // namespace kdray::core
