// SPDX-License-Identifier: Apache-2.0
#include "server/log_query.h"

#include <algorithm>
#include <vector>

#include "api/request_fields.h"

namespace kdray::server {
namespace {

constexpr std::size_t kMaxBytes = 512;

template <class Request>
void AppendNames(const api::FieldTable<Request>& table, std::vector<std::string_view>& names) {
  for (const auto& field : table.fields) names.push_back(field.name);
}

/// Sorted. Names do not depend on limits.
std::vector<std::string_view> NamesOfTheContract() {
  const api::Limits limits;
  std::vector<std::string_view> names;
  AppendNames(api::UploadFields(limits), names);
  AppendNames(api::ListFields(), names);
  AppendNames(api::DescribeFields(limits), names);
  AppendNames(api::MeasureFields(limits), names);
  AppendNames(api::CellsFields(), names);
  AppendNames(api::ClosestFields(limits), names);
  AppendNames(api::AnyFields(limits), names);
  AppendNames(api::CountFields(limits), names);
  AppendNames(api::AllFields(limits), names);
  AppendNames(api::ClosestPointFields(limits), names);
  AppendNames(api::SideFields(limits), names);
  AppendNames(api::VisibilityFields(limits), names);
  AppendNames(api::RenderFields(limits), names);
  std::sort(names.begin(), names.end());
  return names;
}

std::string Shown(std::string_view query) {
  static const std::vector<std::string_view> names = NamesOfTheContract();
  std::string text;
  while (!query.empty() && text.size() <= kMaxBytes) {
    const auto end = std::min(query.find('&'), query.size());
    const std::string_view piece = query.substr(0, end);
    query.remove_prefix(std::min(end + 1, query.size()));
    if (piece.empty()) continue;
    if (!text.empty()) text += '&';
    const auto equals = piece.find('=');
    const bool known = equals != std::string_view::npos &&
                       std::binary_search(names.begin(), names.end(), piece.substr(0, equals));
    text += known ? piece : "***";
  }
  if (text.size() > kMaxBytes) text.replace(kMaxBytes, std::string::npos, "...");
  return text;
}

}  // namespace

std::string LoggedQuery(std::string_view query) noexcept {
  try {
    return Shown(query);
  } catch (...) {
    return {};
  }
}

}  // namespace kdray::server
