// SPDX-License-Identifier: Apache-2.0
#include "core/io/gltf_draco.h"

#include <array>
#include <limits>
#include <utility>

namespace kdray::core {
namespace {

constexpr std::array kUses = {GltfUse::kPosition, GltfUse::kNormal, GltfUse::kUv, GltfUse::kColor};

std::string OfExtension(const std::string& primitive) {
  return primitive + "/extensions/KHR_draco_mesh_compression";
}

}  // namespace

std::optional<std::uint64_t> GltfDraco::AccessorOf(const GltfPrimitive& primitive, GltfUse use) {
  switch (use) {
    case GltfUse::kPosition:
      return primitive.position;
    case GltfUse::kNormal:
      return primitive.normal;
    case GltfUse::kUv:
      return primitive.uv;
    case GltfUse::kColor:
      return primitive.color;
    case GltfUse::kIndices:
      break;
  }
  return primitive.indices;
}

std::optional<std::uint64_t> GltfDraco::IdOf(const GltfPrimitive& primitive, GltfUse use) const {
  const GltfDracoData& data = document_.dracos[*primitive.draco];
  switch (use) {
    case GltfUse::kPosition:
      return data.position;
    case GltfUse::kNormal:
      return data.normal;
    case GltfUse::kUv:
      return data.uv;
    case GltfUse::kColor:
      return data.color;
    case GltfUse::kIndices:
      break;
  }
  return std::nullopt;
}

bool GltfDraco::Wants(GltfUse use) const {
  switch (use) {
    case GltfUse::kPosition:
      return true;
    case GltfUse::kNormal:
      return sink_ != nullptr && sink_->Wants(AttributeKind::kShadingNormal);
    case GltfUse::kUv:
      return sink_ != nullptr && sink_->Wants(AttributeKind::kUv);
    case GltfUse::kColor:
      return sink_ != nullptr && sink_->Wants(AttributeKind::kColor);
    case GltfUse::kIndices:
      break;
  }
  return false;
}

bool GltfDraco::Has(const GltfPrimitive& primitive, GltfUse use) const {
  const std::optional<std::uint64_t> accessor = AccessorOf(primitive, use);
  const std::optional<std::uint64_t> id = IdOf(primitive, use);
  return accessor && id && *id <= std::numeric_limits<std::uint32_t>::max() &&
         accessors_.CheckType(*accessor, use).ok();
}

Status GltfDraco::Check(const GltfPrimitive& primitive, const std::string& pointer) {
  const GltfDracoData& data = document_.dracos[*primitive.draco];
  if (primitive.mode != GltfMode::kTriangles) {
    return AtPointer(pointer, "has Draco data and the mode " +
                                  std::to_string(static_cast<int>(primitive.mode)) +
                                  "; of Draco data, the mode 4 (TRIANGLES) is read");
  }
  if (!primitive.indices) {
    return AtPointer(pointer, "has Draco data and no 'indices', whose count would be needed");
  }
  if (!data.position) {
    return AtPointer(OfExtension(pointer), "the attribute POSITION is missing");
  }
  Status status = accessors_.CheckType(*primitive.position, GltfUse::kPosition);
  if (status.ok()) status = accessors_.CheckType(*primitive.indices, GltfUse::kIndices);
  if (!status.ok()) return status;
  if (const std::uint64_t corners = accessors_.CountOf(*primitive.indices); corners % 3 != 0) {
    return AtPointer(
        GltfPointer("accessors", *primitive.indices),
        "has " + std::to_string(corners) + " indices; those of Draco data are a multiple of 3");
  }
  if (!Has(primitive, GltfUse::kPosition)) {
    return AtPointer(OfExtension(pointer), "the id of the attribute POSITION is " +
                                               std::to_string(*data.position) +
                                               "; ids have 32 bits");
  }
  return accessors_.buffers().Use(data.view, {OfExtension(pointer), /*is_needed=*/true});
}

DracoForm GltfDraco::FormOf(const GltfPrimitive& primitive) const {
  const GltfDracoData& data = document_.dracos[*primitive.draco];
  DracoForm form;
  form.vertices = accessors_.CountOf(*primitive.position);
  form.triangles = accessors_.CountOf(*primitive.indices) / 3;
  form.attributes = data.attributes;
  form.encoded_bytes = document_.views[data.view].bytes;
  for (const GltfUse use : kUses) {
    if (!Wants(use) || !Has(primitive, use)) continue;
    const GltfAccessor& accessor = document_.accessors[*AccessorOf(primitive, use)];
    form.wanted.push_back({static_cast<std::uint32_t>(*IdOf(primitive, use)),
                           static_cast<std::uint32_t>(accessor.type), accessor.components,
                           use == GltfUse::kPosition, GltfAccessors::ElementBytes(accessor)});
  }
  return form;
}

Status GltfDraco::Decode(const GltfPrimitive& primitive, const std::string& pointer) {
  if (decoded_ == &primitive) return {};
  decoded_ = nullptr;
  mesh_ = {};
  Result<DracoMesh> mesh =
      DecodeDraco(accessors_.buffers().Bytes(document_.dracos[*primitive.draco].view),
                  FormOf(primitive), poll_);
  if (!mesh.ok()) {
    if (mesh.error().code != ErrorCode::kInvalidMesh) return std::move(mesh).error();
    return AtPointer(OfExtension(pointer), mesh.error().message);
  }
  mesh_ = *std::move(mesh);
  begins_.fill(std::nullopt);
  std::size_t next = 0;  // in the order of FormOf
  for (const GltfUse use : kUses) {
    if (!Wants(use) || !Has(primitive, use)) continue;
    begins_[static_cast<std::size_t>(use)] = mesh_.values_begin[next++];
  }
  decoded_ = &primitive;
  return {};
}

}  // namespace kdray::core
