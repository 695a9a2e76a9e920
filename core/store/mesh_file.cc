#include "core/store/mesh_file.h"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"

namespace kdray::core {

template <>
inline constexpr bool kStorable<TriangleIndices> = true;

namespace {

// Increment the version when parsing or the layout changes a file's content.
constexpr FileKind kMeshFileKind{"kdraymsh", 2};

std::vector<std::uint8_t> PackBits(const std::vector<bool>& flags) {
  std::vector<std::uint8_t> packed((flags.size() + 7) / 8);
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (flags[i]) packed[i / 8] = static_cast<std::uint8_t>(packed[i / 8] | 1u << i % 8);
  }
  return packed;
}

std::vector<bool> UnpackBits(const std::vector<std::uint8_t>& packed, std::size_t count) {
  std::vector<bool> flags(count);
  for (std::size_t i = 0; i < count; ++i) flags[i] = (packed[i / 8] >> i % 8 & 1u) != 0;
  return flags;
}

bool IndicesAreBelow(std::size_t end, std::span<const TriangleIndices> triangles) {
  for (const TriangleIndices& triangle : triangles) {
    for (const std::uint32_t index : triangle) {
      if (index >= end) return false;
    }
  }
  return true;
}

}  // namespace

Result<NewBlob> WriteMeshFile(const Sha256Digest& mesh, const PreparedMesh& prepared,
                              NewBlob blob) {
  CheckedWriter writer(std::move(blob), kMeshFileKind);
  writer.Put(mesh);
  PutMeshFacts(prepared.facts, &writer);
  prepared.mesh.VisitVertices([&](auto vertices) { writer.PutArray(vertices); });
  writer.PutArray(prepared.mesh.triangles());
  const std::vector<std::uint8_t> degenerate = PackBits(prepared.mesh.degenerate_flags());
  writer.PutArray(std::span(degenerate));
  return std::move(writer).Finish();
}

Result<PreparedMesh> ReadMeshFile(const Sha256Digest& mesh, std::unique_ptr<ReadableFile> file) {
  CheckedReader reader(std::move(file), kMeshFileKind);
  if (reader.Get<Sha256Digest>() != mesh) reader.Fail();
  MeshFacts facts = GetMeshFacts(&reader);
  TriangleMesh::Parts parts;
  parts.format = facts.format;
  parts.frame = facts.frame;
  parts.bounds = facts.bounds;
  if (facts.double_vertices) {
    parts.vertices = reader.GetArray<Vec3d>();
  } else {
    parts.vertices = reader.GetArray<Vec3f>();
  }
  parts.triangles = reader.GetArray<TriangleIndices>();
  const auto degenerate = reader.GetArray<std::uint8_t>();
  if (degenerate.size() != (parts.triangles.size() + 7) / 8) reader.Fail();
  const std::size_t vertex_count =
      std::visit([](const auto& vertices) { return vertices.size(); }, parts.vertices);
  if (!IndicesAreBelow(vertex_count, parts.triangles)) reader.Fail();
  if (Status status = reader.Finish(); !status.ok()) return std::move(status).error();

  parts.degenerate = UnpackBits(degenerate, parts.triangles.size());
  return PreparedMesh{std::move(facts), TriangleMesh::FromParts(std::move(parts))};
}

}  // namespace kdray::core
