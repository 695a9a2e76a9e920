// Which mesh format bytes are of, by the bytes alone.
#pragma once

#include <optional>
#include <string_view>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The format whose reader should be asked. In this order: what has the size of a binary STL with
/// its count; a known foreign file (core/io/foreign_files.h; an error); `ply`; a first statement
/// that only one format has (`solid`, OFF's keyword, a statement of OBJ, three counts); the first
/// line that is surely one of OBJ or STL, whatever stands before it, in the first MiB; bytes that
/// are no text, which only a binary STL can be. Errors: kUnsupportedMeshFormat, with what the bytes
/// are, what to send instead and which formats there are; kEmptyMesh for blanks and comments. O(1),
/// except for comments and blanks. When the poll has stopped, the answer means nothing.
Result<MeshFormat> FindFormat(std::string_view bytes, CancelPoll* poll);

/// kUnsupportedMeshFormat for bytes that are `what`.
Error UnsupportedFormat(std::string_view what, std::string_view advice = {});

}  // namespace kdray::core
