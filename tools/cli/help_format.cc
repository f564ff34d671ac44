#include "cli/help_format.h"

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

// Lines of prose; what is indented, as examples are, stays as it is.
std::string Prose(const std::string& text) {
  std::string all;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    if (line.empty() || line[0] == ' ') {
      absl::StrAppend(&all, line, "\n");
    } else {
      absl::StrAppend(&all, text::Wrapped(line, "", ""));
    }
  }
  return all;
}

}  // namespace

std::string HelpFormat::make_option_desc(const CLI::Option* option) const {
  return Beside(CLI::Formatter::make_option_desc(option), kNames);
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
