#include "core/io/mesh_reader.h"

#include <string>
#include <string_view>

#include "core/io/foreign_files.h"
#include "core/io/format_sniffer.h"
#include "core/io/mesh_error.h"
#include "core/io/obj_reader.h"
#include "core/io/off_reader.h"
#include "core/io/ply_reader.h"
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
    case MeshFormat::kOff:
      break;
  }
  return ReadOff(bytes, options);
}

}  // namespace

Result<MeshData> ReadMesh(std::span<const std::byte> bytes, const MeshReadOptions& options) {
  if (bytes.empty()) return Error{ErrorCode::kEmptyMesh, "the mesh has no bytes"};
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const Result<MeshFormat> format = FindFormat(text);
  if (!format.ok()) return format.error();
  Result<MeshData> mesh = ReadAs(*format, bytes, options);
  if (!mesh.ok() && IsOfTheFile(mesh.error()) && HasLostItsLineBreaks(text)) {
    Error error = std::move(mesh).error();
    error.message += "; " + std::string(kLineBreaksAdvice);
    return error;
  }
  return mesh;
}

}  // namespace kdray::core
