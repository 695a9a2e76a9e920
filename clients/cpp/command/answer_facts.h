// SPDX-License-Identifier: Apache-2.0
// What the headers of an answer say, for people and as JSON.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "kdray/document.h"
#include "kdray/transport.h"

namespace kdray::client {

struct AnswerFacts {
  std::string precision;                        ///< Kdray-Precision; "" if absent
  std::optional<std::uint64_t> samples = {};    ///< Kdray-Samples: of a pixel, the most
  std::optional<double> noise = {};             ///< Kdray-Noise
  std::string stopped;                          ///< Kdray-Stopped
  std::optional<double> trace_ms = {};          ///< `trace` of Server-Timing
  std::optional<std::uint64_t> invalid = {};    ///< Kdray-Invalid: rows
  std::optional<std::uint64_t> truncated = {};  ///< Kdray-Truncated: rows

  static AnswerFacts Of(const HttpResponse& response);

  /// Joins the facts of two parts of one work: durations and rows are added.
  void Add(const AnswerFacts& part);

  /// "watertight precision, 16 samples a pixel, traced in 23.5 ms, 3 invalid rows"; facts that are
  /// absent, and zero rows, are left out.
  std::string Text() const;

  /// Members of a JSON object: "precision", "samples", "noise", "stopped", "trace_ms", "invalid"
  /// and "truncated", if present.
  std::vector<std::pair<std::string, Document>> Members() const;
};

/// The duration of one metric of a Server-Timing header: ("queue;dur=0.1, trace;dur=23", "trace")
/// gives 23; nullopt if it is absent.
std::optional<double> TimingOf(const std::string& server_timing, const std::string& metric);

}  // namespace kdray::client
