// SPDX-License-Identifier: Apache-2.0
// Describes for people how a mesh was modelled, and why.
#pragma once

#include <string>

#include "core/catalog/records.h"

namespace kdray::server {

/// A few sentences: the structure, the storage of vertices, the meaning of precision `auto`, and
/// what is not guaranteed. Shorter before the mesh is parsed or the tree is built.
std::string DescribePlan(const core::TreeRecord& record);

}  // namespace kdray::server
