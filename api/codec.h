// Everything that turns bytes of HTTP into request structs and answer structs into bytes; for
// handlers, in the order in which a request meets it.
#pragma once

#include "api/answer_codec.h"   // IWYU pragma: export
#include "api/batch_codec.h"    // IWYU pragma: export
#include "api/batch_type.h"     // IWYU pragma: export
#include "api/names.h"          // IWYU pragma: export
#include "api/request_codec.h"  // IWYU pragma: export
#include "api/tree_id.h"        // IWYU pragma: export
