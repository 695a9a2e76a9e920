// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/nearest_word.h"

#include <algorithm>
#include <cctype>

namespace kdray::client {
namespace {

// Optimal string alignment distance, ignoring case.
// Source: Navarro, "A Guided Tour to Approximate String Matching", ACM Computing Surveys 33(1),
// 2001, section 2.
std::size_t ErrorsBetween(std::string_view a, std::string_view b) {
  const auto same = [](char x, char y) {
    return std::tolower(static_cast<unsigned char>(x)) ==
           std::tolower(static_cast<unsigned char>(y));
  };
  std::vector<std::vector<std::size_t>> errors(a.size() + 1,
                                               std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) {
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        errors[i][j] = i + j;
        continue;
      }
      const std::size_t replaced = same(a[i - 1], b[j - 1]) ? 0 : 1;
      errors[i][j] =
          std::min({errors[i - 1][j] + 1, errors[i][j - 1] + 1, errors[i - 1][j - 1] + replaced});
      if (i > 1 && j > 1 && same(a[i - 1], b[j - 2]) && same(a[i - 2], b[j - 1])) {
        errors[i][j] = std::min(errors[i][j], errors[i - 2][j - 2] + 1);
      }
    }
  }
  return errors[a.size()][b.size()];
}

}  // namespace

std::string NearestWord(std::string_view word, const std::vector<std::string>& candidates) {
  constexpr std::size_t kLongestWord = 64;  // longer ones are no typing errors, and cost time
  std::string nearest;
  if (word.empty() || word.size() > kLongestWord) return nearest;
  std::size_t fewest = kLongestWord;
  for (const std::string& candidate : candidates) {
    if (candidate.size() > kLongestWord) continue;
    std::size_t errors = ErrorsBetween(word, candidate);
    const bool begins = candidate.starts_with(word) && word.size() > 1;
    if (begins) errors = std::min<std::size_t>(errors, 1);
    if (errors < fewest && (begins || errors * 3 <= std::max(word.size(), candidate.size()))) {
      fewest = errors;
      nearest = candidate;
    }
  }
  return nearest;
}

std::string Suggestion(std::string_view word, const std::vector<std::string>& candidates) {
  const std::string nearest = NearestWord(word, candidates);
  return nearest.empty() ? "" : "; did you mean '" + nearest + "'?";
}

}  // namespace kdray::client
