// SPDX-License-Identifier: Apache-2.0
// The two forms of a batch and its answer: JSON or a .npy array.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "api/types.h"

namespace kdray::api {

enum class BatchType : std::uint8_t { kJson, kNpy };

/// "application/json" or "application/x-npy".
std::string_view ContentType(BatchType type);

/// Detects the form of a batch by its first bytes. (ZIP, which includes .npz, and gzip count as
/// .npy, whose reader says what to send instead.) Content-Type (nullopt or empty: absent) decides
/// only for bytes that are neither. application/octet-stream and application/x-www-form-urlencoded
/// (curl's defaults) count as absent. unsupported_media_type if Content-Type names another type.
Outcome<BatchType> DetectBatchType(std::string_view body,
                                   std::optional<std::string_view> content_type);

/// The same rule for Content-Type, for bodies that must be JSON.
Check CheckJsonContentType(std::optional<std::string_view> content_type);

/// The form of the answer: the one that Accept (RFC 9110, 12.5.1; with q-values) prefers; at equal
/// q-values, the one that it names; otherwise (absent, `*/*`, `application/*`, both named) the
/// request's. not_acceptable if Accept excludes both.
Outcome<BatchType> ChooseAnswerType(std::optional<std::string_view> accept, BatchType request);

}  // namespace kdray::api
