// SPDX-License-Identifier: Apache-2.0
// All enumerators of an enumeration, counted by their names, without a separate list or a last
// enumerator.
#pragma once

#include <array>
#include <cstddef>

namespace kdray::core {

namespace enumerators_detail {
template <class Enum>
consteval std::size_t Count() {
  std::size_t count = 0;
  while (!Name(static_cast<Enum>(count)).empty()) ++count;
  return count;
}
}  // namespace enumerators_detail

/// The enumerators of `Enum` in their order. Their values are 0, 1, 2, …, and Name(Enum) is
/// constexpr and empty for any other value. Name() is a switch without default, so the compiler
/// reports an enumerator without a name.
template <class Enum>
inline constexpr auto kAll = [] {
  std::array<Enum, enumerators_detail::Count<Enum>()> all{};
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<Enum>(i);
  return all;
}();

}  // namespace kdray::core
