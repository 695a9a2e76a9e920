// SPDX-License-Identifier: Apache-2.0
#include "core/io/mesh_reader.h"

#include <string>
#include <string_view>

#include "core/base/cancel_poll.h"
#include "core/io/foreign_files.h"
#include "core/io/format_sniffer.h"
#include "core/io/gltf_reader.h"
#include "core/io/mesh_error.h"
#include "core/io/obj_reader.h"
#include "core/io/off_reader.h"
#include "core/io/ply_reader.h"
#include "core/io/polygon.h"
#include "core/io/stl_reader.h"

namespace kdray::core {
namespace {

Result<MeshData> ReadAs(MeshFormat format, std::span<const std::byte> bytes,
                        const MeshReadOptions& options) {
  switch (format) {
    case MeshFormat::kObj:
      return ReadObj(bytes, options);
    case MeshFormat::kPly:
      return ReadPly(bytes, options);
    case MeshFormat::kStl:
      return ReadStl(bytes, options);
    case MeshFormat::kGlb:
    case MeshFormat::kGltf:
      return ReadGltf(bytes, options);
    case MeshFormat::kOff:
      break;
  }
  return ReadOff(bytes, options);
}

}  // namespace

void MeshCounts::AddFace(std::uint64_t corners) {
  triangles += corners < 3 ? 0 : corners - 2;
  most_corners = std::max(most_corners, corners);
  // A larger polygon is an error unless it is convex.
  if (corners > 3 && corners <= kMaxConcaveCorners) most_cut = std::max(most_cut, corners);
}

std::uint64_t MeshCounts::ReadBytes() const {
  return vertices * sizeof(Vec3d) + triangles * sizeof(TriangleIndices) +
         most_corners * sizeof(std::uint32_t) + most_cut * PolygonCutter::kScratchBytesPerCorner +
         other_bytes;
}

Result<MeshData> ReadMesh(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  if (bytes.empty()) return Error{ErrorCode::kEmptyMesh, "the mesh has no bytes"};
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  CancelPoll poll(options.cancel);
  const Result<MeshFormat> format = FindFormat(text, &poll);
  if (poll.stopped()) return poll.ToError();
  if (!format.ok()) return format.error();
  Result<MeshData> mesh = ReadAs(*format, bytes, options);
  // When the token stops a walk through a text, the reader sees a shorter text.
  if (options.cancel.ShouldStop()) return options.cancel.ToError();
  const bool has_lines = *format != MeshFormat::kGlb && *format != MeshFormat::kGltf;
  if (!mesh.ok() && has_lines && IsOfTheFile(mesh.error()) && HasLostItsLineBreaks(text, &poll)) {
    Error error = std::move(mesh).error();
    error.message += "; " + std::string(kLineBreaksAdvice);
    return error;
  }
  if (poll.stopped()) return poll.ToError();
  return mesh;
}

}  // namespace kdray::core
