// The query of a request target into names and values.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "api/types.h"

namespace kdray::api {

struct Parameter {
  std::string name, value;
};

/// Splits `a=1&b=2` and decodes it as forms do (WHATWG URL, application/x-www-form-urlencoded): '+'
/// is a space, so a plus is written %2B. Empty pieces are skipped; a piece without '=' has an empty
/// value. invalid_parameter for a '%' without two hexadecimal digits and for a name that comes
/// twice.
Outcome<std::vector<Parameter>> ParseQuery(std::string_view query);

}  // namespace kdray::api
