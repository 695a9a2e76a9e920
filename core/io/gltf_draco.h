// SPDX-License-Identifier: Apache-2.0
// The primitives of a glTF file whose numbers are Draco data (KHR_draco_mesh_compression): checked,
// then decoded (core/io/draco_process.h) one at a time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/io/attribute_sink.h"
#include "core/io/draco_process.h"
#include "core/io/gltf_accessors.h"
#include "core/io/gltf_document.h"

namespace kdray::core {

/// For one thread at a time. The primitives that are passed have `draco`.
class GltfDraco {
 public:
  /// `sink`: what else is wanted besides triangles; null for nothing. All must outlive this.
  GltfDraco(const GltfDocument& document, const AttributeSink* sink, GltfAccessors* accessors,
            CancelPoll* poll)
      : document_(document), sink_(sink), accessors_(*accessors), poll_(poll) {}

  /// Whether the primitive says what the data are, and where. `pointer` is its own. kInvalidMesh
  /// with a JSON pointer.
  Status Check(const GltfPrimitive& primitive, const std::string& pointer);
  /// Whether the data are said to have the values of an accessor, which is legal for its use.
  bool Has(const GltfPrimitive& primitive, GltfUse use) const;
  /// The memory that Decode takes, at most.
  std::uint64_t Bytes(const GltfPrimitive& primitive) const { return FormOf(primitive).Bytes(); }

  /// Decodes a primitive that passed Check, after the buffers are decoded, and forgets the one
  /// before it. The same again costs nothing.
  Status Decode(const GltfPrimitive& primitive, const std::string& pointer);
  /// Corner `i` of the triangles that are decoded.
  std::uint32_t Corner(std::uint64_t i) const { return mesh_.Corner(i); }
  /// visit(i, element) for the value of each vertex. False if the data turned out not to have
  /// them, or the poll has stopped.
  template <class Visit>
  bool ForEach(GltfUse use, const Visit& visit) const {
    const std::optional<std::size_t> begin = begins_[static_cast<std::size_t>(use)];
    if (!begin) return false;
    return accessors_.ForEachOf(*AccessorOf(*decoded_, use), mesh_.bytes.data() + *begin, visit);
  }

 private:
  static std::optional<std::uint64_t> AccessorOf(const GltfPrimitive& primitive, GltfUse use);
  std::optional<std::uint64_t> IdOf(const GltfPrimitive& primitive, GltfUse use) const;
  bool Wants(GltfUse use) const;
  DracoForm FormOf(const GltfPrimitive& primitive) const;

  const GltfDocument& document_;
  const AttributeSink* sink_;
  GltfAccessors& accessors_;
  CancelPoll* poll_;
  const GltfPrimitive* decoded_ = nullptr;
  DracoMesh mesh_;
  std::array<std::optional<std::size_t>, 4> begins_;  // in the mesh, by use
};

}  // namespace kdray::core
