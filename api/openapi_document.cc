// SPDX-License-Identifier: Apache-2.0
#include "api/openapi_document.h"

#include "api/openapi_files.h"  // made by the build

namespace kdray::api {

std::string_view OpenApiJson() { return kOpenApiFiles[0].second; }

}  // namespace kdray::api
