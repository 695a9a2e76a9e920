// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_accessors.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "core/io/mesh_error.h"

namespace kdray::core {
namespace {

static_assert(std::endian::native == std::endian::little, "as the numbers in glTF files are");

std::uint64_t SizeOf(GltfType type) {
  switch (type) {
    case GltfType::kByte:
    case GltfType::kUnsignedByte:
      return 1;
    case GltfType::kShort:
    case GltfType::kUnsignedShort:
      return 2;
    case GltfType::kUnsignedInt:
    case GltfType::kFloat:
      break;
  }
  return 4;
}

std::string_view NameOf(GltfUse use) {
  constexpr std::array<std::string_view, 5> kNames = {"POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0",
                                                      "indices"};
  return kNames[static_cast<std::size_t>(use)];
}

std::string_view NameOf(GltfType type) {
  switch (type) {
    case GltfType::kByte:
      return "BYTE";
    case GltfType::kUnsignedByte:
      return "UNSIGNED_BYTE";
    case GltfType::kShort:
      return "SHORT";
    case GltfType::kUnsignedShort:
      return "UNSIGNED_SHORT";
    case GltfType::kUnsignedInt:
      return "UNSIGNED_INT";
    case GltfType::kFloat:
      return "FLOAT";
  }
  return {};
}

// glTF 2.0, section 3.7, and KHR_mesh_quantization.
bool IsLegal(const GltfAccessor& accessor, GltfUse use, bool may_be_quantized) {
  const GltfType type = accessor.type;
  const bool is_float = type == GltfType::kFloat;
  const bool is_int = type == GltfType::kUnsignedInt;
  const bool is_signed = type == GltfType::kByte || type == GltfType::kShort;
  const bool is_fraction = !is_float && !is_int && !is_signed && accessor.normalized;
  switch (use) {
    case GltfUse::kPosition:
      return accessor.components == 3 && (is_float || (may_be_quantized && !is_int));
    case GltfUse::kNormal:
      return accessor.components == 3 &&
             (is_float || (may_be_quantized && is_signed && accessor.normalized));
    case GltfUse::kUv:
      return accessor.components == 2 && (is_float || is_fraction || (may_be_quantized && !is_int));
    case GltfUse::kColor:
      return (accessor.components == 3 || accessor.components == 4) && (is_float || is_fraction);
    case GltfUse::kIndices:
      break;
  }
  return accessor.components == 1 && !is_float && !is_signed && !accessor.normalized;
}

std::string Allowed(GltfUse use) {
  switch (use) {
    case GltfUse::kIndices:
      return "SCALAR of UNSIGNED_BYTE, UNSIGNED_SHORT or UNSIGNED_INT";
    case GltfUse::kPosition:
      return "VEC3 of FLOAT, and with KHR_mesh_quantization of BYTE, UNSIGNED_BYTE, SHORT or "
             "UNSIGNED_SHORT";
    default:
      return "other types";
  }
}

template <class T>
double Load(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return static_cast<double>(value);
}

}  // namespace

GltfAccessors::GltfAccessors(const GltfDocument& document,
                             std::optional<std::span<const std::byte>> binary,
                             std::uint64_t file_bytes, CancelPoll* poll)
    : document_(document), buffers_(document, binary, poll), file_bytes_(file_bytes), poll_(poll) {}

Status GltfAccessors::Check(std::uint64_t number, GltfUse use) {
  const std::string pointer = GltfPointer("accessors", number);
  if (number >= document_.accessors.size()) {
    return AtPointer(pointer, "does not exist; the file has " +
                                  std::to_string(document_.accessors.size()) + " accessors");
  }
  const GltfAccessor& accessor = document_.accessors[number];
  if (!IsLegal(accessor, use, document_.may_be_quantized)) {
    return AtPointer(pointer, "has components of type " + std::string(NameOf(accessor.type)) +
                                  (accessor.normalized ? ", normalized" : "") + ", " +
                                  std::to_string(accessor.components) + " of them; allowed for " +
                                  std::string(NameOf(use)) + " are " + Allowed(use));
  }
  const std::uint64_t element_bytes = accessor.components * SizeOf(accessor.type);
  const bool is_needed = use == GltfUse::kPosition || use == GltfUse::kIndices;
  const auto part = [&](const char* name) { return GltfBuffers::User{pointer + name, is_needed}; };
  if (accessor.view) {
    Status status =
        CheckElements(*accessor.view, accessor.offset, accessor.count, element_bytes, part(""));
    if (!status.ok()) return status;
  } else if (!accessor.sparse && is_needed) {
    return AtPointer(pointer, "has no bufferView and no sparse values, so there are no data for " +
                                  std::string(NameOf(use)) +
                                  " (meshes that only Draco data have are not read)");
  } else if (accessor.count > file_bytes_) {
    return AtPointer(pointer, "has " + std::to_string(accessor.count) +
                                  " elements of value 0 without a bufferView; at most the file's " +
                                  std::to_string(file_bytes_) + " bytes are allowed");
  }
  if (!accessor.sparse) return {};
  const GltfSparse& sparse = *accessor.sparse;
  GltfAccessor indices;
  indices.type = sparse.index_type;
  indices.components = 1;
  if (!IsLegal(indices, GltfUse::kIndices, false)) {
    return AtPointer(pointer + "/sparse/indices",
                     "has components of type " + std::string(NameOf(sparse.index_type)) +
                         "; allowed are " + Allowed(GltfUse::kIndices));
  }
  Status status = CheckElements(sparse.index_view, sparse.index_offset, sparse.count,
                                SizeOf(sparse.index_type), part("/sparse/indices"));
  if (!status.ok()) return status;
  return CheckElements(sparse.value_view, sparse.value_offset, sparse.count, element_bytes,
                       part("/sparse/values"));
}

// No sum or product here can overflow: each is checked against what is left.
Status GltfAccessors::CheckElements(std::uint64_t view_number, std::uint64_t offset,
                                    std::uint64_t count, std::uint64_t element_bytes,
                                    const GltfBuffers::User& user) {
  if (Status status = buffers_.Use(view_number, user); !status.ok()) return status;
  if (count == 0) return {};
  const GltfView& view = document_.views[view_number];
  const std::uint64_t stride = view.stride == 0 ? element_bytes : view.stride;
  const bool fits = offset <= view.bytes && element_bytes <= view.bytes - offset &&
                    count - 1 <= (view.bytes - offset - element_bytes) / stride;
  if (fits) return {};
  return AtPointer(user.pointer, std::to_string(count) + " elements of " +
                                     std::to_string(element_bytes) + " bytes, " +
                                     std::to_string(stride) + " apart, from byte " +
                                     std::to_string(offset) + " on, do not fit into the " +
                                     std::to_string(view.bytes) + " bytes of bufferView " +
                                     std::to_string(view_number));
}

GltfAccessors::Elements GltfAccessors::ElementsOf(const GltfAccessor& accessor) const {
  Elements elements{nullptr, 0, accessor.type, accessor.components, accessor.normalized};
  if (accessor.view && accessor.count != 0) {
    const std::uint64_t stride = document_.views[*accessor.view].stride;
    elements.first = buffers_.Bytes(*accessor.view).data() + accessor.offset;
    elements.stride = stride == 0 ? accessor.components * SizeOf(accessor.type) : stride;
  }
  return elements;
}

GltfAccessors::Sparse GltfAccessors::SparseOf(const GltfAccessor& accessor) const {
  const GltfSparse& sparse = *accessor.sparse;
  if (sparse.count == 0) return {};
  const auto part = [&](std::uint64_t view, std::uint64_t offset, GltfType type, int components,
                        bool normalized) -> Elements {
    const std::uint64_t stride = document_.views[view].stride;
    const std::uint64_t size = static_cast<std::uint64_t>(components) * SizeOf(type);
    return {buffers_.Bytes(view).data() + offset, stride == 0 ? size : stride, type, components,
            normalized};
  };
  return {part(sparse.index_view, sparse.index_offset, sparse.index_type, 1, false),
          part(sparse.value_view, sparse.value_offset, accessor.type, accessor.components,
               accessor.normalized)};
}

GltfElement GltfAccessors::Elements::Get(std::uint64_t i) const {
  GltfElement element{};
  if (first == nullptr) return element;
  const std::byte* from = first + i * stride;
  for (int k = 0; k < components; ++k) {
    double& number = element[static_cast<std::size_t>(k)];
    switch (type) {
      case GltfType::kByte:
        number = Load<std::int8_t>(from + k);
        if (normalized) number = std::max(number / 127, -1.0);
        break;
      case GltfType::kUnsignedByte:
        number = Load<std::uint8_t>(from + k);
        if (normalized) number /= 255;
        break;
      case GltfType::kShort:
        number = Load<std::int16_t>(from + 2 * k);
        if (normalized) number = std::max(number / 32767, -1.0);
        break;
      case GltfType::kUnsignedShort:
        number = Load<std::uint16_t>(from + 2 * k);
        if (normalized) number /= 65535;
        break;
      case GltfType::kUnsignedInt:
        number = Load<std::uint32_t>(from + 4 * k);
        break;
      case GltfType::kFloat:
        number = Load<float>(from + 4 * k);
        break;
    }
  }
  return element;
}

bool GltfAccessors::FailSparse(std::uint64_t accessor, std::uint64_t index) {
  error_ = AtPointer(GltfPointer("accessors", accessor) + "/sparse/indices",
                     "names element " + std::to_string(index) + "; the accessor has " +
                         std::to_string(document_.accessors[accessor].count));
  return false;
}

}  // namespace kdray::core
