// SPDX-License-Identifier: Apache-2.0
#include "api/field.h"

#include "api/quoted.h"

namespace kdray::api {

Problem UnknownField(std::string_view name, const std::vector<std::string_view>& names) {
  std::string detail = "there is no " + Quoted(name) + " here";
  if (names.empty()) detail += "; no parameter is allowed";
  const char* before = "; there are ";
  for (const std::string_view known : names) {
    detail += before;
    detail += known;
    before = ", ";
  }
  return Problem{ErrorCode::kInvalidParameter, std::move(detail), std::string(name)};
}

Problem MissingField(std::string_view name, const FieldKind& kind) {
  return Problem{ErrorCode::kInvalidParameter,
                 std::string(name) + " is missing; it must be " + Describe(kind),
                 std::string(name)};
}

}  // namespace kdray::api
