// What --help says, for a terminal of 80 columns.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace cairn::cli {

class HelpFormat : public CLI::Formatter {
 public:
  HelpFormat() { column_width(kNames); }

  std::string make_option(const CLI::Option* option, bool is_positional) const override;
  std::string make_option_name(const CLI::Option* option, bool is_positional) const override;
  // Without what it needs and excludes, which its description ends with.
  std::string make_option_opts(const CLI::Option* option) const override;
  std::string make_option_desc(const CLI::Option* option) const override;
  std::string make_subcommand(const CLI::App* verb) const override;
  std::string make_description(const CLI::App* verb) const override;
  std::string make_footer(const CLI::App* verb) const override;

 private:
  static constexpr std::size_t kNames = 26;  // columns of names of options and verbs
};

}  // namespace cairn::cli
