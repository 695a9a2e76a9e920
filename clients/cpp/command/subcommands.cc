// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/subcommands.h"

#include <algorithm>
#include <string_view>

namespace kdray::client {

namespace {

Option FieldOption(const Field& field, std::string* value) {
  std::string name = std::string("--") + field.name;
  std::replace(name.begin(), name.end(), '_', '-');
  return {.name = std::move(name),
          .help = field.help,
          .value = value,
          .type = field.type,
          .values = SplitAtCommas(field.values)};
}

}  // namespace

Parameters ParametersOf(std::span<const Field> fields, std::span<const std::string> values) {
  Parameters parameters;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (!values[i].empty()) parameters.emplace_back(fields[i].name, values[i]);
  }
  return parameters;
}

std::vector<std::string> SplitAtCommas(std::string_view text) {
  std::vector<std::string> words;
  while (!text.empty()) {
    const std::size_t comma = std::min(text.find(','), text.size());
    words.emplace_back(text.substr(0, comma));
    text.remove_prefix(std::min(comma + 1, text.size()));
  }
  return words;
}

Option TreeOption(std::string* value) {
  return {.name = "tree",
          .help = "Tree, or a mesh to upload first: a file, or - for standard input",
          .value = value,
          .type = "ID|FILE",
          .required = true};
}

void AddFieldOptions(Subcommand* command, std::span<const Field> fields,
                     std::span<std::string> values) {
  for (std::size_t i = 0; i < fields.size(); ++i) {
    command->options.push_back(FieldOption(fields[i], &values[i]));
  }
}

}  // namespace kdray::client
