#include "clients/cpp/command/subcommands.h"

#include <algorithm>

namespace kdray::client {

Option FieldOption(const Field& field, std::string* value) {
  std::string name = std::string("--") + field.name;
  std::replace(name.begin(), name.end(), '_', '-');
  return {.name = std::move(name), .help = field.help, .value = value, .type = field.type};
}

}  // namespace kdray::client
