// SPDX-License-Identifier: Apache-2.0
// Splits the query of a request target into names and values.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "api/types.h"

namespace kdray::api {

struct Parameter {
  std::string name, value;
};

/// Splits `a=1&b=2` and decodes the percent signs (RFC 3986). '+' is a plus sign, not a space as in
/// forms, because numbers contain it (1e+5). Empty pieces are skipped; a piece without '=' has an
/// empty value. invalid_parameter for a '%' without two hexadecimal digits and for a repeated name.
Outcome<std::vector<Parameter>> ParseQuery(std::string_view query);

}  // namespace kdray::api
