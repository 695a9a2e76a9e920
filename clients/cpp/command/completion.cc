// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/completion.h"

#include <algorithm>

namespace kdray::client {
namespace {

std::vector<std::string> ValuesOf(const Option& option) {
  return option.choices.empty() ? option.values : option.choices;
}

bool NamesFile(const Option& option) {
  for (const char* word : {"FILE", "RAYS", "POINTS"}) {
    if (option.type.find(word) != std::string::npos) return true;
  }
  return false;
}

std::string Joined(const std::vector<std::string>& words, const char* separator = " ") {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : separator) + word;
  return text;
}

// In single quotes for a shell.
std::string Quoted(const std::string& text, const char* escaped_quote = "'\\''") {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? escaped_quote : std::string(1, c);
  return quoted + "'";
}

// The names of options, and which of them take a value.
std::vector<std::string> OptionNames(const std::vector<Option>& options, bool only_with_value) {
  std::vector<std::string> names;
  for (const Option& option : options) {
    if (IsPositional(option) || (only_with_value && !TakesValue(option))) continue;
    for (std::string& name : NamesOf(option)) names.push_back(std::move(name));
  }
  return names;
}

// Lines of a `case` on the word before, for the options whose values are known.
std::string BashValueCases(const std::vector<Option>& options) {
  std::string cases;
  for (const Option& option : options) {
    if (IsPositional(option) || !TakesValue(option)) continue;
    const std::string pattern = "      " + Joined(NamesOf(option), "|") + ") ";
    if (const auto values = ValuesOf(option); !values.empty()) {
      cases += pattern + "COMPREPLY=($(compgen -W " + Quoted(Joined(values)) +
               " -- \"$current\")); return ;;\n";
    } else if (NamesFile(option)) {
      cases += pattern + "compopt -o default; return ;;\n";
    } else {
      cases += pattern + "return ;;\n";
    }
  }
  return cases;
}

// What may stand where no option does: a word of a list, or a file.
std::string BashPositionals(const std::vector<Option>& options) {
  for (const Option& option : options) {
    if (!IsPositional(option)) continue;
    if (const auto values = ValuesOf(option); !values.empty()) {
      return "COMPREPLY=($(compgen -W " + Quoted(Joined(values)) + " -- \"$current\"))";
    }
    if (NamesFile(option)) return "compopt -o default";
  }
  return "true";
}

}  // namespace

std::string BashCompletion(const CommandLine& line) {
  std::vector<std::string> names;
  for (const Subcommand& subcommand : line.subcommands) names.push_back(subcommand.name);
  const std::string general = Joined(OptionNames(line.options, false));
  std::string script =
      "# bash completion of kdray; made by `kdray completion bash`.\n"
      "_kdray() {\n"
      "  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]}\n"
      "  local command= word i\n"
      "  COMPREPLY=()\n"
      "  for ((i = 1; i < COMP_CWORD; i++)); do\n"
      "    word=${COMP_WORDS[i]}\n"
      "    case $word in\n"
      "      " +
      Joined(OptionNames(line.options, true), "|") +
      ") i=$((i + 1)) ;;\n"
      "      -*) ;;\n"
      "      *) command=$word; break ;;\n"
      "    esac\n"
      "  done\n"
      "  case $previous in\n" +
      BashValueCases(line.options) +
      "  esac\n"
      "  case $command in\n"
      "    '')\n"
      "      COMPREPLY=($(compgen -W " +
      Quoted(Joined(names) + " " + general + " --help --version") + " -- \"$current\")) ;;\n";
  for (const Subcommand& subcommand : line.subcommands) {
    const std::string own = Joined(OptionNames(subcommand.options, false));
    script += "    " + subcommand.name + ")\n";
    if (const std::string cases = BashValueCases(subcommand.options); !cases.empty()) {
      script += "      case $previous in\n" + cases + "      esac\n";
    }
    script +=
        "      if [[ $current == -?* ]]; then\n"
        "        COMPREPLY=($(compgen -W " +
        Quoted(own + " " + general + " --help") +
        " -- \"$current\"))\n"
        "      else\n"
        "        " +
        BashPositionals(subcommand.options) +
        "\n"
        "      fi ;;\n";
  }
  return script + "  esac\n}\ncomplete -F _kdray kdray\n";
}

namespace {

// _arguments reads `[help]` and `:message:action`; colons and brackets in texts are escaped.
std::string ZshText(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == ':' || c == '[' || c == ']' || c == '\\') escaped += '\\';
    escaped += c;
  }
  return escaped;
}

std::string ZshAction(const Option& option) {
  if (const auto values = ValuesOf(option); !values.empty()) return "(" + Joined(values) + ")";
  return NamesFile(option) ? "_files" : "";
}

std::string ZshArguments(const std::vector<Option>& options) {
  std::string text;
  for (const Option& option : options) {
    const std::string value = ":" + ZshText(ValueName(option)) + ":" + ZshAction(option);
    if (IsPositional(option)) {
      // A list, as the files of upload, takes any number of words.
      const bool many =
          std::holds_alternative<std::vector<std::string>*>(option.value) && !option.count;
      text += " \\\n        " + Quoted((many ? "*" : "") + value);
      continue;
    }
    for (const std::string& name : NamesOf(option)) {
      text += " \\\n        " +
              Quoted(name + "[" + ZshText(option.help) + "]" + (TakesValue(option) ? value : ""));
    }
  }
  return text;
}

}  // namespace

std::string ZshCompletion(const CommandLine& line) {
  std::string script =
      "#compdef kdray\n"
      "# zsh completion of kdray; made by `kdray completion zsh`.\n"
      "_kdray() {\n"
      "  local context state line curcontext=$curcontext\n"
      "  typeset -A opt_args\n"
      "  _arguments -C" +
      ZshArguments(line.options) +
      " \\\n        '--help[Print help]' '--version[Print the version]'"
      " \\\n        '1:command:->command' '*::argument:->argument'\n"
      "  case $state in\n"
      "    command)\n"
      "      local -a commands=(\n";
  for (const Subcommand& subcommand : line.subcommands) {
    script += "        " + Quoted(subcommand.name + ":" + ZshText(subcommand.help)) + "\n";
  }
  script +=
      "      )\n      _describe command commands ;;\n"
      "    argument)\n      case $line[1] in\n";
  for (const Subcommand& subcommand : line.subcommands) {
    script += "        " + subcommand.name + ")\n          _arguments" +
              ZshArguments(subcommand.options) + ZshArguments(line.options) +
              " \\\n        '--help[Print help]' ;;\n";
  }
  return script +
         "      esac ;;\n  esac\n}\n"
         "[[ $funcstack[1] == _kdray ]] && _kdray \"$@\" || compdef _kdray kdray\n";
}

namespace {

std::string FishQuoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text)
    quoted += c == '\'' || c == '\\' ? std::string("\\") + c : std::string(1, c);
  return quoted + "'";
}

std::string FishOptions(const std::vector<Option>& options, const std::string& condition) {
  std::string text;
  for (const Option& option : options) {
    if (IsPositional(option)) {
      if (const auto values = ValuesOf(option); !values.empty()) {
        text += "complete -c kdray" + condition + " -f -a " + FishQuoted(Joined(values)) + "\n";
      } else if (NamesFile(option)) {
        text += "complete -c kdray" + condition + " -F\n";
      }
      continue;
    }
    text += "complete -c kdray" + condition;
    for (const std::string& name : NamesOf(option)) {
      text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
    }
    if (TakesValue(option)) {
      const auto values = ValuesOf(option);
      text += !values.empty()     ? " -x -a " + FishQuoted(Joined(values))
              : NamesFile(option) ? " -r -F"
                                  : " -x";
    }
    text += " -d " + FishQuoted(option.help) + "\n";
  }
  return text;
}

}  // namespace

std::string FishCompletion(const CommandLine& line) {
  std::string script =
      "# fish completion of kdray; made by `kdray completion fish`.\n"
      "complete -c kdray -f\n" +
      FishOptions(line.options, "");
  for (const Subcommand& subcommand : line.subcommands) {
    script += "complete -c kdray -n __fish_use_subcommand -a " + subcommand.name + " -d " +
              FishQuoted(subcommand.help) + "\n" +
              FishOptions(subcommand.options,
                          " -n '__fish_seen_subcommand_from " + subcommand.name + "'");
  }
  return script;
}

}  // namespace kdray::client
