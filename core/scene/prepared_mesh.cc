#include "core/scene/prepared_mesh.h"

#include <chrono>
#include <utility>

#include "core/io/mesh_reader.h"

namespace kdray::core {

Result<PreparedMesh> PrepareMesh(std::span<const std::byte> bytes, const CancelToken& cancel) {
  const auto start = std::chrono::steady_clock::now();
  const Result<MeshData> data = ReadMesh(bytes, MeshReadOptions{cancel});
  if (!data.ok()) return data.error();
  Result<TriangleMesh> mesh = TriangleMesh::Create(*data, cancel);
  if (!mesh.ok()) return std::move(mesh).error();
  const Result<MeshHealth> health = CheckHealth(*mesh, *data, cancel);
  if (!health.ok()) return health.error();

  MeshFacts facts;
  facts.format = data->format;
  facts.file_bytes = bytes.size();
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
  facts.parse_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return PreparedMesh{std::move(facts), *std::move(mesh)};
}

}  // namespace kdray::core
