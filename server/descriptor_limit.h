// SPDX-License-Identifier: Apache-2.0
// The process's limit of open files, and how many connections fit into it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace kdray::server {

struct DescriptorLimit {
  std::uint64_t descriptors = 0;  ///< that the process may have open
  std::size_t connections = 0;    ///< that they suffice for
};

/// Descriptors for `connections` connections that all upload or download meshes at the same time,
/// and for the rest of the daemon.
std::uint64_t DescriptorsFor(std::size_t connections);
/// The most connections that `descriptors` suffice for, at least 1.
std::size_t ConnectionsWithin(std::uint64_t descriptors);

/// Raises the soft limit to what `max_connections` need, as far as the hard one allows, and returns
/// the result; `connections` is at most `max_connections`. Call it before threads open files.
DescriptorLimit RaiseDescriptorLimit(std::size_t max_connections);

}  // namespace kdray::server
