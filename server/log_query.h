// SPDX-License-Identifier: Apache-2.0
// What the log shows of a request's query string.
#pragma once

#include <string>
#include <string_view>

namespace kdray::server {

/// The parameters of the contract with their values, as sent; `***` in the place of every other
/// one, because clients put secrets into parameters that the contract does not have. At most 512
/// bytes, then "...". Empty if there is no memory for it.
std::string LoggedQuery(std::string_view query) noexcept;

}  // namespace kdray::server
