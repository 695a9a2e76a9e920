// A client's own text inside a message.
#pragma once

#include <string>
#include <string_view>

namespace kdray::api {

/// `text` in single quotes, fit for a log line and a JSON document: printable ASCII as it is, other
/// bytes as `\xNN`, cut after 60 bytes.
std::string Quoted(std::string_view text);

}  // namespace kdray::api
