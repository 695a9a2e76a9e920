// SPDX-License-Identifier: Apache-2.0
#include "core/library/parse_mesh.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "core/geometry/mesh_measure.h"
#include "core/io/attribute_sink.h"

namespace kdray::core {
namespace {

using SteadyClock = std::chrono::steady_clock;

// Frees `text` after parsing, if it owns memory.
Result<ParsedMesh> Parse(std::span<const std::byte> bytes, std::vector<std::byte> text,
                         const CancelToken& cancel, const OnMeshCounts& on_counts) {
  const auto start = SteadyClock::now();
  MeshFacts facts;
  facts.file_bytes = bytes.size();
  // Of attributes only the names of groups, which a description has.
  AttributeSink names{AttributeKinds()};
  Result<MeshData> data = ReadMesh(bytes, MeshReadOptions{cancel, on_counts, &names});
  text = std::vector<std::byte>();
  if (!data.ok()) return std::move(data).error();
  Result<TriangleMesh> mesh = TriangleMesh::Create(&*data, cancel);
  if (!mesh.ok()) return std::move(mesh).error();
  const Result<MeshHealth> health = CheckHealth(*mesh, *data, cancel);
  if (!health.ok()) return health.error();
  const Result<MeshMeasure> measure = MeasureMesh(*mesh, cancel);
  if (!measure.ok()) return measure.error();
  std::vector<std::string> group_names = names.TakeGroupNames();

  facts.format = data->format;
  facts.triangles = mesh->triangle_count();
  facts.dropped = data->dropped;
  facts.vertices = mesh->vertex_count();
  facts.bounds = mesh->bounds();
  facts.health = *health;
  facts.double_vertices = mesh->has_double_vertices();
  facts.wider_than_declared = data->wider_than_declared;
  facts.frame = mesh->frame();
  facts.rounded_vertices = mesh->has_rounded_vertices();
  facts.shortest_edge = mesh->shortest_edge();
  facts.memory_bytes = mesh->bytes();
  facts.area = measure->area;
  if (health->closed) facts.volume = measure->volume;
  facts.groups = static_cast<std::uint32_t>(group_names.size());
  facts.parse_ms = std::chrono::duration<double, std::milli>(SteadyClock::now() - start).count();
  return ParsedMesh{std::move(facts), *std::move(mesh), std::move(group_names)};
}

constexpr std::uint64_t BytesOfMesh(const MeshCounts& counts, std::uint64_t vertex_bytes) {
  return counts.vertices * vertex_bytes + counts.triangles * sizeof(TriangleIndices) +
         counts.triangles / 8;
}

// What does not grow with the file.
constexpr std::uint64_t kFixedBytes = 64 << 10;

// Scratch memory of CheckHealth.
constexpr std::uint64_t HealthScratchBytes(const MeshCounts& counts) {
  return 10 * counts.vertices + std::max(counts.vertices / 8, 8 * counts.triangles);
}

}  // namespace

Result<ParsedMesh> ParseMesh(std::vector<std::byte> bytes, const CancelToken& cancel,
                             const OnMeshCounts& on_counts) {
  const std::span<const std::byte> all = bytes;  // stays valid when the vector is moved
  return Parse(all, std::move(bytes), cancel, on_counts);
}

Result<ParsedMesh> ParseMesh(std::span<const std::byte> bytes, const CancelToken& cancel) {
  return Parse(bytes, {}, cancel, {});
}

std::uint64_t ReadPeakBytes(std::uint64_t file_bytes, const MeshCounts& counts) {
  const std::uint64_t vertices = counts.vertices * sizeof(Vec3d);
  const std::uint64_t triangles = counts.triangles * sizeof(TriangleIndices);
  // Arrays with a large claimed size begin with twice the file's bytes (core/io/claimed_rows.h).
  const auto growth = [&](std::uint64_t bytes) {
    return bytes > 2 * file_bytes ? 2 * file_bytes : 0;
  };
  return kFixedBytes + file_bytes + counts.ReadBytes() + counts.vertices / 8 +
         std::max(growth(vertices), growth(triangles));
}

// Three phases, one after the other: the file's bytes and the MeshData read from them; MeshData and
// the mesh made from it; the mesh, the vertices that were read, and the scratch of the health
// report.
std::uint64_t ParsePeakBytes(std::uint64_t file_bytes, const MeshCounts& counts) {
  const std::uint64_t vertices = counts.vertices * sizeof(Vec3d);
  const std::uint64_t mesh = BytesOfMesh(counts, sizeof(Vec3d));
  const std::uint64_t creating = vertices + counts.vertices / 8 + mesh;  // triangles are moved
  const std::uint64_t judging = vertices + mesh + HealthScratchBytes(counts);
  return std::max(ReadPeakBytes(file_bytes, counts), kFixedBytes + std::max(creating, judging));
}

std::uint64_t LeastMeshBytes(const MeshCounts& counts) {
  return BytesOfMesh(counts, sizeof(Vec3f));
}

}  // namespace kdray::core
