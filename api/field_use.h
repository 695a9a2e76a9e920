// SPDX-License-Identifier: Apache-2.0
// The tables of the modes, projections and forms of the answer that use each field of a render, and
// of the fields that replace others. A new mode or field changes only these tables.
#pragma once

#include <string>

#include "api/field.h"
#include "api/types.h"

namespace kdray::api {

/// invalid_parameter for the first field that the request's mode, projection or form does not use,
/// or that another field replaces, unless its value is the default. `pointer` is put before the
/// name of the field.
Check CheckFieldsAreUsed(const RenderRequest& request, ImageForm form,
                         const FieldTable<RenderRequest>& table, const std::string& pointer);

}  // namespace kdray::api
