// SPDX-License-Identifier: Apache-2.0
// Finds vertices and faces among the elements of a PLY file.
#pragma once

#include <array>
#include <cstddef>

#include "core/base/result.h"
#include "core/io/ply_header.h"

namespace kdray::core {

/// The places of the properties that a mesh needs, in rows of a PLY file. Points into the header.
struct PlyColumns {
  const PlyElement* vertex = nullptr;
  const PlyElement* face = nullptr;  ///< or `tristrips`
  bool is_strips = false;
  std::array<std::size_t, 3> xyz{};
  std::size_t corners = 0;
};

/// Errors: kEmptyMesh without faces; kInvalidMesh with the line of the header if a property is
/// missing, twice there or of the wrong kind.
Result<PlyColumns> FindPlyColumns(const PlyHeader& header);

}  // namespace kdray::core
