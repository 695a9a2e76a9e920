// SPDX-License-Identifier: Apache-2.0
#include "kdray/find_tree.h"

#include <algorithm>

#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr std::size_t kDigestLength = 64;
constexpr std::size_t kShortestPrefix = 6;

struct IdParts {
  std::string_view digest;
  std::string_view build;  ///< with its dash; empty when not given
};

IdParts Split(std::string_view text) {
  const std::size_t dash = text.find('-');
  if (dash == std::string_view::npos) return {text, {}};
  return {text.substr(0, dash), text.substr(dash)};
}

}  // namespace

bool LooksLikeTreeId(std::string_view text) {
  const auto [digest, build] = Split(text);
  return digest.size() >= kShortestPrefix && digest.size() <= kDigestLength && build != "-" &&
         digest.find_first_not_of("0123456789abcdef") == std::string_view::npos &&
         build.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789.-") ==
             std::string_view::npos;
}

std::string ResolveTreeId(Client& client, const std::string& text) {
  if (!LooksLikeTreeId(text))
    throw UsageError("'" + Printable(text) +
                     "' is not a tree id, nor the first six digits or more of one");
  const auto [digest, build] = Split(text);
  if (digest.size() == kDigestLength && !build.empty()) return text;

  std::vector<std::string> found;
  std::string after;
  do {
    const TreePage page = client.ListTrees(after);
    for (const Tree& tree : page.trees) {
      const IdParts parts = Split(tree.id);
      if (parts.digest.starts_with(digest) && (build.empty() || parts.build == build))
        found.push_back(tree.id);
    }
    after = page.next.value_or("");
  } while (!after.empty());

  if (found.size() == 1) return found.front();
  if (found.empty())
    throw UsageError("no tree on " + client.options().server.Text() + " begins with '" + text +
                     "' (kdray list shows what is there)");
  std::string message = "'" + text + "' could be any of";
  for (const std::string& id : found) message += "\n  " + ShortTreeId(id);
  throw UsageError(message);
}

}  // namespace kdray::client
