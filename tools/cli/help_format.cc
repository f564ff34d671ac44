#include "cli/help_format.h"

#include <set>
#include <sstream>
#include <vector>

#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

// Lines that fit behind `columns` others; where CLI11 breaks a line, it indents the next by itself.
std::string Beside(const std::string& text, std::size_t columns) {
  const std::string indent(columns, ' ');
  std::vector<std::string> lines;
  const std::string wrapped = text::Wrapped(text, indent, indent);
  for (absl::string_view line : absl::StrSplit(wrapped, '\n', absl::SkipEmpty())) {
    line.remove_prefix(columns);
    lines.emplace_back(line);
  }
  return absl::StrJoin(lines, "\n");
}

// What an option takes, one of many words perhaps, behind two blanks.
std::string BrokenAtCommas(const std::string& text, const std::string& next_indent) {
  std::string all, line = "  ";
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const bool first = all.empty() && line.size() == 2;
    if (!first) line += ',';
    if (text::DisplayWidth(line) + text::DisplayWidth(part) + 1 > text::kTextColumns) {
      absl::StrAppend(&all, line, "\n");
      line = next_indent;
    }
    absl::StrAppend(&line, part);
  }
  return absl::StrCat(all, line).substr(2);
}

std::string NamesOf(const std::set<CLI::Option*>& options) {
  std::set<std::string> names;  // the same order each time
  for (const CLI::Option* option : options) names.insert(option->get_name());
  return absl::StrJoin(names, ", ");
}

// A command that is longer than a line goes on in the next one, as shells have it: broken between its words, and
// before an option if there is one.
std::string Command(absl::string_view line) {
  constexpr absl::string_view kGoesOn = " \\", kIndent = "      ";
  std::string all, rest(line);
  while (text::DisplayWidth(rest) > text::kTextColumns) {
    std::size_t at = std::string::npos;  // of the blank to break at
    bool at_option = false;
    char quote = '\0';
    for (std::size_t i = rest.find_first_not_of(' '); i <= text::kTextColumns - kGoesOn.size(); ++i) {
      const char c = rest[i];
      if (c == '"' || c == '\'') quote = quote == '\0' ? c : quote == c ? '\0' : quote;
      const bool before_option = rest.compare(i, 2, " -") == 0;
      if (c != ' ' || quote != '\0' || (at_option && !before_option)) continue;
      at = i;
      at_option = before_option;
    }
    if (at == std::string::npos) break;
    absl::StrAppend(&all, rest.substr(0, at), kGoesOn, "\n");
    rest = absl::StrCat(kIndent, rest.substr(at + 1));
  }
  return absl::StrCat(all, rest, "\n");
}

// Lines of prose; what is indented are examples.
std::string Prose(const std::string& text) {
  std::string all;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    if (line.empty() || line[0] == ' ') {
      absl::StrAppend(&all, Command(line));
    } else {
      absl::StrAppend(&all, text::Wrapped(line, "", ""));
    }
  }
  return all;
}

}  // namespace

std::string HelpFormat::make_option(const CLI::Option* option, bool is_positional) const {
  std::stringstream out;
  CLI::detail::format_help(out,
                           BrokenAtCommas(make_option_name(option, is_positional) + make_option_opts(option), "      "),
                           make_option_desc(option), kNames);
  return out.str();
}

std::string HelpFormat::make_option_name(const CLI::Option* option, bool is_positional) const {
  const std::string name = CLI::Formatter::make_option_name(option, is_positional);
  return name.substr(0, name.find('{'));  // what a flag means where it is given: "--alike{false}"
}

std::string HelpFormat::make_option_opts(const CLI::Option* option) const {
  std::string options = CLI::Formatter::make_option_opts(option);
  for (const char* label : {"Needs", "Excludes"}) {
    if (const auto at = options.find(absl::StrCat(" ", get_label(label), ":")); at != std::string::npos) {
      options.resize(at);
    }
  }
  return options;
}

std::string HelpFormat::make_option_desc(const CLI::Option* option) const {
  std::string text = CLI::Formatter::make_option_desc(option);
  if (!option->get_needs().empty()) absl::StrAppend(&text, " (goes with ", NamesOf(option->get_needs()), ")");
  if (!option->get_excludes().empty()) absl::StrAppend(&text, " (not with ", NamesOf(option->get_excludes()), ")");
  return Beside(text, kNames);
}

std::string HelpFormat::make_subcommand(const CLI::App* verb) const {
  std::stringstream out;
  CLI::detail::format_help(out, verb->get_display_name(true), Beside(verb->get_description(), kNames), kNames);
  return out.str();
}

std::string HelpFormat::make_description(const CLI::App* verb) const {
  return verb->get_description().empty() ? "" : Prose(verb->get_description());
}

std::string HelpFormat::make_footer(const CLI::App* verb) const {
  return verb->get_footer().empty() ? "" : Prose(verb->get_footer());
}

}  // namespace cairn::cli
