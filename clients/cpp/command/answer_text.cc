#include "clients/cpp/command/answer_text.h"

namespace kdray::client {

std::string TimingOf(const std::string& server_timing, const std::string& metric) {
  std::size_t begin = 0;
  while (begin < server_timing.size()) {
    std::size_t end = server_timing.find(',', begin);
    if (end == std::string::npos) end = server_timing.size();
    std::string entry = server_timing.substr(begin, end - begin);
    entry.erase(0, entry.find_first_not_of(' '));
    const std::string wanted = metric + ";dur=";
    if (entry.starts_with(wanted)) return entry.substr(wanted.size());
    begin = end + 1;
  }
  return {};
}

std::string AnswerText(const HttpResponse& response) {
  std::string text;
  const auto add = [&](const std::string& before, const std::string& value,
                       const std::string& after) {
    if (value.empty()) return;
    if (!text.empty()) text += ", ";
    text += before + value + after;
  };
  add("", response.Header("kdray-precision"), " precision");
  add("", response.Header("kdray-samples"), " samples a pixel");
  add("traced in ", TimingOf(response.Header("server-timing"), "trace"), " ms");
  for (const auto& [header, after] : {std::pair{"kdray-invalid", " invalid rows"},
                                      std::pair{"kdray-truncated", " rows cut short"}}) {
    const std::string count = response.Header(header);
    if (count != "0") add("", count, after);
  }
  return text;
}

}  // namespace kdray::client
