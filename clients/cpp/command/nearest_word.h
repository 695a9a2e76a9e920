// SPDX-License-Identifier: Apache-2.0
// Suggests what a mistyped word was meant to be.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace kdray::client {

/// The candidate with the fewest typing errors (letters inserted, left out, replaced or swapped
/// with their neighbour), or "" if none is near: at most a third of the longer word's letters
/// differ, or one word begins with the other. Of equally near ones the first.
std::string NearestWord(std::string_view word, const std::vector<std::string>& candidates);

/// "; did you mean 'upload'?", or "" if none is near.
std::string Suggestion(std::string_view word, const std::vector<std::string>& candidates);

}  // namespace kdray::client
