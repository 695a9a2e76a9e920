// SPDX-License-Identifier: Apache-2.0
// The readable contract at /docs. The build makes its first part from the OpenAPI document
// (cmake/contract_page.py); the table of errors follows.
#pragma once

#include <string>

namespace kdray::server {

/// Every path and method of the contract with its parameters, body and answers, then the errors.
std::string MakeContractPage();

}  // namespace kdray::server
