// SPDX-License-Identifier: Apache-2.0
// Times as text: in the contract, the log and HTTP. All in UTC.
#pragma once

#include <cstdint>
#include <string>

namespace kdray::server {

std::int64_t UnixMsNow();

/// Milliseconds since 1970 as RFC 3339 has it: 2023-11-14T22:13:20.123Z. Times before 1970 are
/// given as 1970.
std::string Rfc3339(std::int64_t unix_ms);

/// The same as an HTTP date (IMF-fixdate, RFC 9110, 5.6.7): Tue, 14 Nov 2023 22:13:20 GMT.
std::string HttpDate(std::int64_t unix_ms);

}  // namespace kdray::server
