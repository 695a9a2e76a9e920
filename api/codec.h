// All decoders of requests and encoders of answers, for handlers.
#pragma once

#include "api/answer_codec.h"   // IWYU pragma: export
#include "api/batch_codec.h"    // IWYU pragma: export
#include "api/batch_type.h"     // IWYU pragma: export
#include "api/names.h"          // IWYU pragma: export
#include "api/request_codec.h"  // IWYU pragma: export
#include "api/tree_id.h"        // IWYU pragma: export
