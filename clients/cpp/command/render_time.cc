// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/render_time.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "clients/cpp/command/answer_facts.h"
#include "clients/cpp/command/subcommands.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

constexpr double kScale = 8;  // of the small picture's sides

std::string Text(const Parameters& fields, const std::string& name) {
  for (const auto& [known, value] : fields) {
    if (known == name) return value;
  }
  return {};
}

double Number(const std::string& text, double absent) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  return end != text.c_str() && *end == '\0' && std::isfinite(number) ? number : absent;
}

std::vector<double> Numbers(const std::string& text) {
  std::vector<double> numbers;
  for (const std::string& word : SplitAtCommas(text)) numbers.push_back(Number(word, 0));
  return numbers;
}

std::string Joined(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) {
    std::array<char, 32> digits;
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), number);
    text += (text.empty() ? "" : ",") + std::string(digits.data(), end);
  }
  return text;
}

// The same view with an eighth of the width and height.
Parameters Smaller(const Parameters& fields) {
  const auto shrunk = [](double pixels) { return std::max(1.0, std::round(pixels / kScale)); };
  Parameters smaller;
  for (const auto& [name, value] : fields) {
    if (name == "width" || name == "height" || name == "intrinsic" || name == "region") continue;
    smaller.emplace_back(name, value);
  }
  smaller.emplace_back("width", Joined({shrunk(Number(Text(fields, "width"), 640))}));
  smaller.emplace_back("height", Joined({shrunk(Number(Text(fields, "height"), 480))}));
  if (std::vector<double> intrinsic = Numbers(Text(fields, "intrinsic")); !intrinsic.empty()) {
    for (double& value : intrinsic) value /= kScale;
    smaller.emplace_back("intrinsic", Joined(intrinsic));
  }
  return smaller;
}

}  // namespace

RenderWork RenderWorkOf(const Parameters& fields) {
  RenderWork work;
  work.pixels = Number(Text(fields, "width"), 640) * Number(Text(fields, "height"), 480);
  const std::vector<double> region = Numbers(Text(fields, "region"));
  if (region.size() == 4) work.pixels = (region[2] - region[0]) * (region[3] - region[1]);
  work.pixels = std::max(work.pixels, 1.0);
  const bool costs_more = Text(fields, "mode") == "ambient-occlusion" ||
                          Number(Text(fields, "samples"), 1) > 1 ||
                          !Text(fields, "max_noise").empty() || !Text(fields, "lights").empty() ||
                          Text(fields, "shadows") == "true";
  work.may_be_long = work.pixels >= 1e6 || (costs_more && work.pixels >= 2e4);
  return work;
}

std::optional<std::chrono::duration<double>> ExpectedTime(Client& client, const std::string& id,
                                                          const std::string& format,
                                                          const Parameters& fields) {
  const RenderWork work = RenderWorkOf(fields);
  const double budget_ms = Number(Text(fields, "budget_ms"), 0);
  if (budget_ms > 0) return std::chrono::duration<double>(budget_ms / 1000);
  if (!work.may_be_long) return std::nullopt;
  try {
    const Parameters smaller = Smaller(fields);
    const auto begin = std::chrono::steady_clock::now();
    const Answer answer = client.Render(id, format, smaller);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    // The rest, as loading the tree or waiting for a turn, does not grow with the picture.
    const std::string timing = answer.response.Header("server-timing");
    const std::chrono::duration<double, std::milli> grows(TimingOf(timing, "trace").value_or(0) +
                                                          TimingOf(timing, "encode").value_or(0));
    const double scale = work.pixels / RenderWorkOf(smaller).pixels;
    const double rest_s = took.count() - std::chrono::duration<double>(grows).count();
    return std::chrono::duration<double>(std::max(rest_s, 0.0)) + grows * scale;
  } catch (const Refusal&) {
    return std::nullopt;
  }
}

}  // namespace kdray::client
