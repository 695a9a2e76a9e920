// SPDX-License-Identifier: Apache-2.0
// The numbers of a glTF file: its accessors, checked against the views that they are in
// (core/io/gltf_buffers.h).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/io/gltf_buffers.h"
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
  /// buffers, which will be decoded. kInvalidMesh with the JSON pointer.
  Status Check(std::uint64_t accessor, GltfUse use);
  /// Of an accessor that passed Check.
  std::uint64_t CountOf(std::uint64_t accessor) const {
    return document_.accessors[accessor].count;
  }

  /// Where the elements are. Decode them after all checks and before ForEach; the accessors of a
  /// buffer that turns out broken no longer pass Check.
  GltfBuffers& buffers() { return buffers_; }

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

  Status CheckElements(std::uint64_t view, std::uint64_t offset, std::uint64_t count,
                       std::uint64_t element_bytes, const GltfBuffers::User& user);
  Elements ElementsOf(const GltfAccessor& accessor) const;
  Sparse SparseOf(const GltfAccessor& accessor) const;
  bool FailSparse(std::uint64_t accessor, std::uint64_t index);

  const GltfDocument& document_;
  GltfBuffers buffers_;
  std::uint64_t file_bytes_;
  CancelPoll* poll_;
  Error error_;
};

}  // namespace kdray::core
