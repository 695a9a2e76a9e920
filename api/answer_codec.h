// SPDX-License-Identifier: Apache-2.0
// Encodes the small answers as JSON text (UTF-8, no line breaks). For batches: api/batch_codec.h.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "api/errors.h"
#include "api/limits.h"
#include "api/types.h"

namespace kdray::api {

std::string EncodeDescription(const TreeDescription& tree);
std::string EncodePage(const TreePage& page);
std::string EncodeCells(const std::vector<Cell>& cells);
/// One row for every build with every precision. A rate of 0 has `below`, its bound at 95%
/// confidence.
std::string EncodeTradeoff(const Tradeoff& tradeoff);

/// GET /v1: name, version, formats, builds, precisions, limits.
std::string EncodeCapabilities(std::string_view version, const Limits& limits);

/// application/problem+json (RFC 9457).
inline constexpr std::string_view kProblemContentType = "application/problem+json";
std::string EncodeProblem(const Problem& problem, std::string_view request_id);

}  // namespace kdray::api
