// Which fields of a render belong to which mode, projection or form of the answer, as one table. A
// new mode or field adds to the table and to nothing else.
#pragma once

#include <string>

#include "api/field.h"
#include "api/types.h"

namespace kdray::api {

/// invalid_parameter for the first field that the request's mode, projection or form does not use,
/// unless its value is the default. `pointer` goes before the name of the field.
Check CheckFieldsAreUsed(const RenderRequest& request, ImageForm form,
                         const FieldTable<RenderRequest>& table, const std::string& pointer);

}  // namespace kdray::api
