// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/manual.h"

#include <algorithm>

namespace kdray::client {
namespace {

// Text that roff prints as it is.
std::string Roff(const std::string& text) {
  std::string escaped;
  bool at_line_start = true;
  for (const char c : text) {
    if (at_line_start && (c == '.' || c == '\'')) escaped += "\\&";
    if (c == '\\') {
      escaped += "\\e";
    } else if (c == '-') {
      escaped += "\\-";
    } else {
      escaped += c;
    }
    at_line_start = c == '\n';
  }
  return escaped;
}

std::string Bold(const std::string& text) { return "\\fB" + Roff(text) + "\\fR"; }
std::string Italic(const std::string& text) { return "\\fI" + Roff(text) + "\\fR"; }

// "-o, --output FILE" and below it the help.
std::string Entry(const Option& option) {
  std::string head;
  if (IsPositional(option)) {
    head = Italic(ValueName(option));
  } else {
    for (const std::string& name : NamesOf(option)) {
      head += (head.empty() ? "" : ", ") + Bold(name);
    }
    if (TakesValue(option)) head += " " + Italic(ValueName(option));
  }
  std::string help = Roff(option.help) + ".";
  if (!option.environment.empty()) help += " Also by " + Bold(option.environment) + ".";
  if (!option.choices.empty()) {
    std::string choices;
    for (const std::string& choice : option.choices) {
      choices += (choices.empty() ? "" : ", ") + Bold(choice);
    }
    help += " One of " + choices + ".";
  }
  return ".TP\n" + head + "\n" + help + "\n";
}

std::string Usage(const Subcommand& subcommand) {
  std::string usage = "\\fBkdray " + Roff(subcommand.name) + "\\fR";
  for (const Option& option : subcommand.options) {
    if (!IsPositional(option)) continue;
    usage += " " + Italic(ValueName(option));
    if (std::holds_alternative<std::vector<std::string>*>(option.value) && !option.count) {
      usage += "...";
    }
  }
  for (const Option& option : subcommand.options) {
    if (IsPositional(option) || !option.required) continue;
    usage += " " + Bold(NamesOf(option).front()) + " " + Italic(ValueName(option));
  }
  return usage + " [" + Italic("OPTION") + "...]";
}

}  // namespace

std::string ManualPage(const CommandLine& line) {
  std::string page = ".TH KDRAY 1 \"\" \"kdray " KDRAY_VERSION
                     "\" \"User Commands\"\n"
                     ".SH NAME\n"
                     "kdray \\- ray queries and renders of meshes, by a kdrayd server\n"
                     ".SH SYNOPSIS\n"
                     "\\fBkdray\\fR [" +
                     Italic("OPTION") + "...] " + Italic("COMMAND") + " [" + Italic("ARGUMENT") +
                     "...]\n"
                     ".SH DESCRIPTION\n" +
                     Roff(line.summary) + "\n.PP\n";
  // The footer's paragraphs, with lines that a terminal may fill anew.
  for (std::size_t begin = 0; begin < line.footer.size();) {
    const std::size_t end = std::min(line.footer.find("\n\n", begin), line.footer.size());
    page += Roff(line.footer.substr(begin, end - begin)) + "\n.PP\n";
    begin = end + 2;
  }
  page += ".SH OPTIONS\nThey may stand before or after the command.\n";
  for (const Option& option : line.options) page += Entry(option);
  page +=
      ".TP\n\\fB\\-\\-help\\fR\nPrint help; after a command, that of the command.\n"
      ".TP\n\\fB\\-\\-version\\fR\nPrint the version.\n"
      ".SH COMMANDS\n";
  for (const Subcommand& subcommand : line.subcommands) {
    page += ".SS " + Usage(subcommand) + "\n" + Roff(subcommand.help) + ".\n";
    for (const Option& option : subcommand.options) page += Entry(option);
    if (!subcommand.footer.empty()) {
      page += ".PP\n.nf\n" + Roff(subcommand.footer) + "\n.fi\n";
    }
  }
  return page +
         ".SH EXAMPLES\n.nf\n"
         "kdray sample teapot \\-o teapot.ply\n"
         "kdray upload teapot.ply\n"
         "kdray render teapot.ply \\-o teapot.png \\-\\-size 1280x960\n"
         "kdray sample\\-rays \\-o \\- | kdray rays teapot.ply \\- \\-o hits.npy\n"
         ".fi\n"
         ".SH SEE ALSO\n"
         "\\fBkdrayd\\fR(8)\n";
}

}  // namespace kdray::client
