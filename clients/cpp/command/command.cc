// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <functional>
#include <ostream>
#include <type_traits>
#include <variant>
#include <vector>

#include "clients/cpp/command/command_line.h"
#include "clients/cpp/command/nearest_word.h"
#include "clients/cpp/command/output_file.h"
#include "clients/cpp/command/session.h"
#include "kdray/error.h"

namespace kdray::client {
namespace {

// The first line is `kdray: …`; further lines are indented.
int Complain(Console& console, const std::string& message, int code) {
  console.out.flush();
  console.err << "kdray: " << Printable(message) << "\n";
  return code;
}

// As CLI::IsMember, but an error names the nearest choice.
CLI::Validator ChoiceOf(const Option& option) {
  std::string list;
  for (const std::string& choice : option.choices) list += (list.empty() ? "" : ",") + choice;
  const auto check = [name = option.name, choices = option.choices](const std::string& word) {
    if (std::find(choices.begin(), choices.end(), word) != choices.end()) return std::string();
    return "there is no " + name + " '" + word + "'" + Suggestion(word, choices);
  };
  return CLI::Validator(check, "{" + list + "}");
}

void Require(CLI::Option& added, const Option& option) {
  if (option.required) added.required();
  if (!option.type.empty()) added.type_name(option.type);
  if (option.help_tells_default) added.capture_default_str();
  if (option.last_wins) added.take_last();
  if (!option.environment.empty()) added.envname(option.environment);
  if (!option.choices.empty()) added.check(ChoiceOf(option));
  if (option.count) added.expected(*option.count);
  if (option.split_at_commas) added.delimiter(',');
}

// The template parameter of CLI::Range, which its help names, is the type of the value.
template <typename T>
void Add(CLI::App& app, const Option& option, T& value) {
  if constexpr (std::is_same_v<T, bool>) {
    app.add_flag(option.name, value, option.help);
  } else {
    CLI::Option* added = app.add_option(option.name, value, option.help);
    if constexpr (std::is_integral_v<T>)
      if (option.range)
        added->check(
            CLI::Range(static_cast<T>(option.range->min), static_cast<T>(option.range->max)));
    Require(*added, option);
  }
}

void Add(CLI::App& app, const std::vector<Option>& options) {
  for (const Option& option : options)
    std::visit([&](auto* value) { Add(app, option, *value); }, option.value);
}

void Add(CLI::App& app, const Subcommand& subcommand) {
  CLI::App* added = app.add_subcommand(subcommand.name, subcommand.help);
  if (!subcommand.footer.empty()) added->footer(subcommand.footer);
  Add(*added, subcommand.options);
  added->callback(subcommand.run);
}

// Whether "-1" or "-.5,2" is meant as a number.
bool IsNumber(const std::string& word) {
  return word.size() > 1 && (std::isdigit(static_cast<unsigned char>(word[1])) || word[1] == '.');
}

const Option* FindOption(const std::vector<Option>& options, const std::string& name) {
  for (const Option& option : options) {
    const auto names = NamesOf(option);
    if (std::find(names.begin(), names.end(), name) != names.end()) return &option;
  }
  return nullptr;
}

// Throws UsageError for the value of an option that is empty, which is mostly a variable of the
// shell that is not set, or that is itself an option by `is_option`, so the value was forgotten.
void CheckValue(const Option& option, const std::string& name, const std::string& value,
                const std::function<bool(const std::string&)>& is_option) {
  if (value.empty() && !option.may_be_empty) {
    throw UsageError(name + ": the value is empty; leave the option out for its default");
  }
  if (value.starts_with("--") && is_option && is_option(value)) {
    throw UsageError(name + " needs a value, and '" + value + "' follows it");
  }
}

// Throws UsageError for a subcommand or an option that does not exist; the text names the nearest
// that does. CLI11, which checks the rest, only says that a word was not expected. Returns the
// subcommand, or nullptr if there is none.
const Subcommand* CheckWords(const CommandLine& line, std::span<const std::string> arguments) {
  const Subcommand* subcommand = nullptr;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string& word = arguments[i];
    if (word == "--") break;
    if (!word.starts_with('-') || word == "-" || IsNumber(word)) {
      if (subcommand != nullptr) continue;
      subcommand = line.Find(word);
      if (subcommand != nullptr) continue;
      std::vector<std::string> names;
      for (const Subcommand& known : line.subcommands) names.push_back(known.name);
      throw UsageError("there is no command '" + word + "'" + Suggestion(word, names) +
                       "\n  kdray --help lists the commands");
    }
    const bool is_long = word.starts_with("--");
    const std::string name = is_long ? word.substr(0, word.find('=')) : word.substr(0, 2);
    if (name == "--help" || name == "-h" || name == "--version") continue;
    const Option* option = FindOption(line.options, name);
    if (option == nullptr && subcommand != nullptr) option = FindOption(subcommand->options, name);
    if (option == nullptr) {
      std::vector<std::string> names;
      for (const auto* options :
           {subcommand != nullptr ? &subcommand->options : &line.options, &line.options}) {
        for (const Option& known : *options) {
          if (IsPositional(known)) continue;
          for (std::string& each : NamesOf(known)) {
            if (each.starts_with("--") == is_long) names.push_back(std::move(each));
          }
        }
      }
      const std::string where = subcommand != nullptr ? "kdray " + subcommand->name : "kdray";
      throw UsageError(where + " has no option '" + name + "'" + Suggestion(name, names) + "\n  " +
                       where + " --help lists the options");
    }
    if (!TakesValue(*option)) continue;
    const std::size_t equals = is_long ? word.find('=') : word.size() > 2 ? 1 : std::string::npos;
    if (equals != std::string::npos) {
      CheckValue(*option, name, word.substr(equals + 1), {});
    } else if (++i < arguments.size()) {
      const auto known = [&](const std::string& next) {
        return FindOption(line.options, next) != nullptr ||
               (subcommand != nullptr && FindOption(subcommand->options, next) != nullptr);
      };
      CheckValue(*option, name, arguments[i], known);
    }
  }
  return subcommand;
}

// "; did you mean 'shaded'?" for the word of an option that the server has refused.
std::string SuggestionFor(const Problem& problem, const Subcommand* subcommand) {
  if (subcommand == nullptr || !problem.parameter) return {};
  for (const Option& option : subcommand->options) {
    const auto* const text = std::get_if<std::string*>(&option.value);
    std::string name = option.name.starts_with("--") ? option.name.substr(2) : option.name;
    std::replace(name.begin(), name.end(), '-', '_');
    if (text == nullptr || option.values.empty() || name != *problem.parameter) continue;
    for (const std::string& word : SplitAtCommas(**text)) {
      const auto& known = option.values;
      if (std::find(known.begin(), known.end(), word) != known.end()) continue;
      const std::string nearest = NearestWord(word, known);
      if (!nearest.empty()) return "\n  did you mean '" + nearest + "'?";
    }
  }
  return {};
}

int Parse(const CommandLine& line, std::span<const std::string> arguments, Console& console,
          const Subcommand* subcommand) {
  CLI::App app(line.summary, "kdray");
  app.set_version_flag("--version", "kdray " KDRAY_VERSION);
  app.require_subcommand(1);
  app.fallthrough();  // general options may also follow the subcommand
  app.footer(line.footer);
  Add(app, line.options);
  for (const Subcommand& known : line.subcommands) Add(app, known);
  try {
    std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());  // as CLI11 wants them
    app.parse(std::move(reversed));
    console.out.flush();
    CheckOutput(console);
    return kExitOk;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {  // --help and --version
      app.exit(error, console.out, console.err);
      console.out.flush();
      CheckOutput(console);
      return kExitOk;
    }
    const std::string where = subcommand != nullptr ? "kdray " + subcommand->name : "kdray";
    return Complain(console, std::string(error.what()) + "\n  " + where + " --help says more",
                    kExitUsage);
  }
}

}  // namespace

int RunCommand(std::span<const std::string> arguments, Console console) {
  Session session(console);
  const CommandLine line = MakeCommandLine(session);
  const Subcommand* subcommand = nullptr;
  try {
    subcommand = CheckWords(line, arguments);
    return Parse(line, arguments, session.console(), subcommand);
  } catch (const ClosedPipe&) {
    return kExitClosedPipe;
  } catch (const Reported& failure) {
    return failure.code;
  } catch (const Refusal& error) {
    return Complain(console, error.what() + SuggestionFor(error.problem, subcommand), kExitRefused);
  } catch (const UsageError& error) {
    return Complain(console, error.what(), kExitUsage);
  } catch (const ConnectionError& error) {
    return Complain(console, error.what(), kExitConnection);
  } catch (const LocalFileError& error) {
    return Complain(console, error.what(), kExitLocalFile);
  }
}

}  // namespace kdray::client
