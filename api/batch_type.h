// Which of the two forms a batch and its answer have: JSON or a .npy array.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "api/types.h"

namespace kdray::api {

enum class BatchType : std::uint8_t { kJson, kNpy };

/// "application/json" or "application/x-npy".
std::string_view ContentType(BatchType type);

/// Tells the form of a batch by its first bytes (those of ZIP, which an .npz file is, and of gzip
/// count as .npy, whose reader says what to send instead); what Content-Type says (nullopt or
/// empty: nothing) only decides for bytes that are neither. unsupported_media_type when
/// Content-Type names something else than these two; application/octet-stream and
/// application/x-www-form-urlencoded (curl's defaults) name nothing.
Outcome<BatchType> DetectBatchType(std::string_view body,
                                   std::optional<std::string_view> content_type);

/// For bodies that can only be JSON: the same rule for Content-Type.
Check CheckJsonContentType(std::optional<std::string_view> content_type);

/// The form of the answer: the one that Accept (RFC 9110, 12.5.1; with q-values) prefers, at equal
/// q-values the one it names, and the request's where that decides nothing (absent, `*/*`,
/// `application/*`, both named). not_acceptable when it excludes both.
Outcome<BatchType> ChooseAnswerType(std::optional<std::string_view> accept, BatchType request);

}  // namespace kdray::api
