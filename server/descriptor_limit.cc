// SPDX-License-Identifier: Apache-2.0
#include "server/descriptor_limit.h"

#include <sys/resource.h>

#include <algorithm>

namespace kdray::server {
namespace {

/// A socket, a mesh file, and the folder that is synced with it.
constexpr std::uint64_t kPerConnection = 3;
/// Standard streams, locks, builds and loads in the background, a spare.
constexpr std::uint64_t kReserved = 64;

}  // namespace

std::uint64_t DescriptorsFor(std::size_t connections) {
  return kReserved + kPerConnection * connections;
}

std::size_t ConnectionsWithin(std::uint64_t descriptors) {
  const std::uint64_t left = descriptors - std::min(descriptors, kReserved);
  return static_cast<std::size_t>(std::max<std::uint64_t>(1, left / kPerConnection));
}

DescriptorLimit RaiseDescriptorLimit(std::size_t max_connections) {
  rlimit limit{};
  const rlim_t needed = DescriptorsFor(max_connections);
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return {needed, max_connections};
  if (limit.rlim_cur < needed) {
    rlimit raised = limit;
    raised.rlim_cur = std::min<rlim_t>(needed, limit.rlim_max);
    if (setrlimit(RLIMIT_NOFILE, &raised) == 0) limit = raised;
  }
  return {limit.rlim_cur, std::min(max_connections, ConnectionsWithin(limit.rlim_cur))};
}

}  // namespace kdray::server
