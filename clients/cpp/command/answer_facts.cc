// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/answer_facts.h"

#include <algorithm>
#include <cstdlib>

#include "clients/cpp/command/text.h"

namespace kdray::client {
namespace {

std::optional<double> NumberOf(const std::string& text) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  if (end == text.c_str()) return std::nullopt;
  return number;
}

std::optional<std::uint64_t> CountOf(const std::string& text) {
  const auto number = NumberOf(text);
  if (!number || !(*number >= 0 && *number < 1e18)) return std::nullopt;
  return static_cast<std::uint64_t>(*number);
}

template <class T>
void AddTo(std::optional<T>& sum, const std::optional<T>& part) {
  if (part) sum = sum.value_or(T{}) + *part;
}

template <class T>
void KeepLargest(std::optional<T>& largest, const std::optional<T>& part) {
  if (part) largest = std::max(largest.value_or(*part), *part);
}

}  // namespace

std::optional<double> TimingOf(const std::string& server_timing, const std::string& metric) {
  std::size_t begin = 0;
  while (begin < server_timing.size()) {
    const std::size_t end = std::min(server_timing.find(',', begin), server_timing.size());
    std::string entry = server_timing.substr(begin, end - begin);
    entry.erase(0, entry.find_first_not_of(' '));
    const std::string wanted = metric + ";dur=";
    if (entry.starts_with(wanted)) return NumberOf(entry.substr(wanted.size()));
    begin = end + 1;
  }
  return std::nullopt;
}

AnswerFacts AnswerFacts::Of(const HttpResponse& response) {
  return {.precision = response.Header("kdray-precision"),
          .samples = CountOf(response.Header("kdray-samples")),
          .noise = NumberOf(response.Header("kdray-noise")),
          .stopped = response.Header("kdray-stopped"),
          .trace_ms = TimingOf(response.Header("server-timing"), "trace"),
          .invalid = CountOf(response.Header("kdray-invalid")),
          .truncated = CountOf(response.Header("kdray-truncated"))};
}

void AnswerFacts::Add(const AnswerFacts& part) {
  if (precision.empty()) precision = part.precision;
  if (stopped.empty()) stopped = part.stopped;
  KeepLargest(samples, part.samples);
  KeepLargest(noise, part.noise);
  AddTo(trace_ms, part.trace_ms);
  AddTo(invalid, part.invalid);
  AddTo(truncated, part.truncated);
}

std::string AnswerFacts::Text() const {
  std::string text;
  const auto add = [&](const std::string& fact) { text += (text.empty() ? "" : ", ") + fact; };
  if (!precision.empty()) add(precision + " precision");
  if (samples) add(CountedText(*samples, "samples") + " a pixel");
  if (trace_ms) add("traced in " + DurationText(*trace_ms));
  if (invalid.value_or(0) > 0) add(CountedText(*invalid, "invalid rows"));
  if (truncated.value_or(0) > 0) add(CountedText(*truncated, "rows") + " cut short");
  return text;
}

std::vector<std::pair<std::string, Document>> AnswerFacts::Members() const {
  std::vector<std::pair<std::string, Document>> members;
  const auto add = [&](const char* name, const auto& fact) {
    if (fact) members.emplace_back(name, Document(*fact));
  };
  if (!precision.empty()) members.emplace_back("precision", Document(precision));
  add("samples", samples);
  add("noise", noise);
  if (!stopped.empty()) members.emplace_back("stopped", Document(stopped));
  add("trace_ms", trace_ms);
  add("invalid", invalid);
  add("truncated", truncated);
  return members;
}

}  // namespace kdray::client
