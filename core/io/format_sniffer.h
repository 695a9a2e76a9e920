// SPDX-License-Identifier: Apache-2.0
// Detects the mesh format from the bytes alone.
#pragma once

#include <optional>
#include <string_view>

#include "core/base/cancel_poll.h"
#include "core/base/result.h"
#include "core/geometry/triangle_mesh.h"

namespace kdray::core {

/// The format whose reader should read the bytes. Checked in this order: the exact size of a binary
/// STL with its count; a known foreign file (core/io/foreign_files.h; an error); `ply`; a first
/// statement that only one format has (`solid`, OFF's keyword, a statement of OBJ, three counts);
/// in the first MiB, a line that only OBJ or STL has, whatever precedes it; bytes that are not
/// text, which can only be a binary STL. Errors: kUnsupportedMeshFormat, which says what the bytes
/// are, what to send instead and which formats are supported; kEmptyMesh for blanks and comments.
/// O(1), except for comments and blanks. When the poll has stopped, the result is unspecified.
Result<MeshFormat> FindFormat(std::string_view bytes, CancelPoll* poll);

/// kUnsupportedMeshFormat: the bytes are `what`.
Error UnsupportedFormat(std::string_view what, std::string_view advice = {});

}  // namespace kdray::core
