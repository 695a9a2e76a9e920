// SPDX-License-Identifier: Apache-2.0
// What a request will cost, estimated before it is computed: its work, which chooses its lane, and
// the memory of pictures.
#pragma once

#include <cstdint>
#include <functional>

#include "api/points.h"
#include "api/types.h"
#include "api/visibility.h"

namespace kdray::server {

/// The work of a body by its bytes, in rays that take as long. It is known before the body is read,
/// and no less than the rows that the body can have in .npy.
using WorkOfBody = std::function<std::uint64_t(std::uint64_t bytes)>;

/// `hits_per_ray` that the query lists at most; 1 for closest, any and count.
WorkOfBody WorkOfRays(std::int64_t hits_per_ray);
WorkOfBody WorkOfPoints();
/// The pairs of the two sets; at most `max_pairs`.
WorkOfBody WorkOfVisibility(const api::VisibilityOptions& options, std::uint64_t max_pairs);

std::uint64_t WorkOfPicture(const api::RenderRequest& request, api::ImageForm form);

/// Cells are at most some 100,000 boxes.
inline constexpr std::uint64_t kWorkOfCells = 100'000;

/// Memory of the rays in work, which are a part of the batch, and of their hits before they are
/// written.
std::uint64_t MemoryOfBlock(std::uint64_t rows, std::int64_t hits_per_ray);

/// Memory of a list of at most `max_cells` cells, and of its text.
std::uint64_t MemoryOfCells(const api::CellsRequest& request, std::uint64_t max_cells);

/// Memory of a picture at its peak, in bytes: the renderer's pixels and the encoder's.
std::uint64_t MemoryOfPicture(const api::RenderRequest& request, api::ImageForm form);

}  // namespace kdray::server
