// SPDX-License-Identifier: Apache-2.0
// Gives memory back to the system before its owner frees it.
#pragma once

#include <cstddef>
#include <span>

namespace kdray::server {

/// Releases the whole pages within `bytes`, whose content is lost. They stay the owner's, and take
/// memory again when they are written. Returns the number of released bytes; 0 if the system
/// refuses.
std::size_t ReleasePages(std::span<const char> bytes);

}  // namespace kdray::server
