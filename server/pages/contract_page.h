// The contract for people: /docs, made from the OpenAPI document and the table of errors.
#pragma once

#include <string>
#include <string_view>

namespace kdray::server {

/// Every path and method of the document with its parameters, body and answers, then the errors.
/// `openapi_json` is our own document, in JSON.
std::string MakeContractPage(std::string_view openapi_json);

}  // namespace kdray::server
