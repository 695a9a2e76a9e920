// SPDX-License-Identifier: Apache-2.0
// Finds the tree that a user's text names.
#pragma once

#include <string>

#include "kdray/client.h"

namespace kdray::client {

/// Whether `text` can be a tree id or the beginning of one: at least six hex digits of the mesh's
/// hash (`3f2a9c`), alone or followed by the whole build (`3f2a9c-kd-sah`).
bool LooksLikeTreeId(std::string_view text);

/// The one tree of the server that `text` names: a whole id, or the beginning of one. Throws
/// UsageError if no tree or more than one matches. A whole id costs no request.
std::string ResolveTreeId(Client& client, const std::string& text);

}  // namespace kdray::client
