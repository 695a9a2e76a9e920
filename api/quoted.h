// SPDX-License-Identifier: Apache-2.0
// Quotes a client's text in a message.
#pragma once

#include <string>
#include <string_view>

namespace kdray::api {

/// `text` in single quotes, valid in a log line and a JSON document: printable ASCII unchanged,
/// other bytes as `\xNN`, cut after 60 bytes.
std::string Quoted(std::string_view text);

}  // namespace kdray::api
