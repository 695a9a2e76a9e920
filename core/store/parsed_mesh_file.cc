// SPDX-License-Identifier: Apache-2.0
#include "core/store/parsed_mesh_file.h"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/base/cancel_poll.h"
#include "core/geometry/mesh_measure.h"
#include "core/store/checked_file.h"
#include "core/store/facts_codec.h"

namespace kdray::core {

template <>
inline constexpr bool kStorable<TriangleIndices> = true;

namespace {

// Increment the version when parsing or the layout changes a file's content.
constexpr FileKind kMeshFileKind{"kdraymsh", 3, 2};
constexpr std::uint32_t kFirstWithSurfaceFacts = 3;

// Work of a flag, and of a triangle's indices (CancelPoll). What comes back means nothing once the
// poll has stopped.
constexpr std::uint64_t kFlagWork = 2;
constexpr std::uint64_t kTriangleWork = 4;

std::vector<std::uint8_t> PackBits(const std::vector<bool>& flags, CancelPoll* poll) {
  std::vector<std::uint8_t> packed((flags.size() + 7) / 8);
  PolledLoop(flags.size(), kFlagWork, poll, [&](std::size_t i) {
    if (flags[i]) packed[i / 8] = static_cast<std::uint8_t>(packed[i / 8] | 1u << i % 8);
  });
  return packed;
}

std::vector<bool> UnpackBits(const std::vector<std::uint8_t>& packed, std::size_t count,
                             CancelPoll* poll) {
  std::vector<bool> flags(count);
  PolledLoop(count, kFlagWork, poll,
             [&](std::size_t i) { flags[i] = (packed[i / 8] >> i % 8 & 1u) != 0; });
  return flags;
}

bool IndicesAreBelow(std::size_t end, std::span<const TriangleIndices> triangles,
                     CancelPoll* poll) {
  bool are_below = true;
  PolledLoop(triangles.size(), kTriangleWork, poll, [&](std::size_t i) {
    for (const std::uint32_t index : triangles[i]) are_below = are_below && index < end;
  });
  return are_below;
}

}  // namespace

Result<NewBlob> WriteParsedMeshFile(const Sha256Digest& mesh, const ParsedMesh& parsed,
                                    NewBlob blob, const CancelToken& cancel) {
  CheckedWriter writer(std::move(blob), kMeshFileKind, cancel);
  writer.Put(mesh);
  PutMeshFacts(parsed.facts, &writer);
  PutSurfaceFacts(parsed.facts, &writer);
  parsed.mesh.VisitVertices([&](auto vertices) { writer.PutArray(vertices); });
  writer.PutArray(parsed.mesh.triangles());
  CancelPoll poll(cancel);
  const std::vector<std::uint8_t> degenerate = PackBits(parsed.mesh.degenerate_flags(), &poll);
  if (poll.stopped()) return poll.ToError();
  writer.PutArray(std::span(degenerate));
  return std::move(writer).Finish();
}

Result<ParsedMesh> ReadParsedMeshFile(const Sha256Digest& mesh, std::unique_ptr<ReadableFile> file,
                                      const CancelToken& cancel) {
  CheckedReader reader(std::move(file), kMeshFileKind, cancel);
  if (reader.Get<Sha256Digest>() != mesh) reader.Fail();
  MeshFacts facts = GetMeshFacts(&reader);
  if (reader.version() >= kFirstWithSurfaceFacts) GetSurfaceFacts(&reader, &facts);
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
  CancelPoll poll(cancel);
  if (!IndicesAreBelow(vertex_count, parts.triangles, &poll)) reader.Fail();
  if (poll.stopped()) return poll.ToError();
  if (Status status = reader.Finish(); !status.ok()) return std::move(status).error();

  parts.degenerate = UnpackBits(degenerate, parts.triangles.size(), &poll);
  if (poll.stopped()) return poll.ToError();
  Result<TriangleMesh> made = TriangleMesh::FromParts(std::move(parts), cancel);
  if (!made.ok()) return std::move(made).error();
  if (reader.version() < kFirstWithSurfaceFacts) {
    const Result<MeshMeasure> measure = MeasureMesh(*made, cancel);
    if (!measure.ok()) return measure.error();
    facts.area = measure->area;
    if (facts.health.closed) facts.volume = measure->volume;
  }
  return ParsedMesh{std::move(facts), *std::move(made)};
}

}  // namespace kdray::core
