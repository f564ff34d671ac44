#include "token_command.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <iostream>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/access/tokens.h"

namespace cairn::server {
namespace {

using FileOf = std::function<absl::StatusOr<std::string>()>;

struct CreateOptions {
  std::string name, maps, rights = "read", expires, output;
};

// A new file that only its owner reads. One that is not written to in the end is removed.
class SecretFile {
 public:
  ~SecretFile() {
    if (fd_ < 0) return;
    close(fd_);
    unlink(path_.c_str());
  }
  absl::Status Create(const std::string& path) {
    path_ = path;
    fd_ = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd_ >= 0) return absl::OkStatus();
    return absl::FailedPreconditionError(absl::StrCat("--output ", path, ": ", std::strerror(errno)));
  }
  absl::Status Write(absl::string_view secret) {
    const bool written = write(fd_, secret.data(), secret.size()) == static_cast<ssize_t>(secret.size());
    if (!written || fsync(fd_) != 0) {
      return absl::UnavailableError(
          absl::StrCat("writing ", path_, ": ", std::strerror(errno), ": revoke the token and make it again"));
    }
    close(std::exchange(fd_, -1));
    return absl::OkStatus();
  }

 private:
  std::string path_;
  int fd_ = -1;
};

std::string DayOf(std::int64_t unix_s) {
  return absl::FormatTime("%Y-%m-%d %H:%M", absl::FromUnixSeconds(unix_s), absl::UTCTimeZone());
}

// "90d": so many days from now; "2027-01-31": the start of that day, "2027-01-31T12:00:00Z": that moment, UTC.
absl::StatusOr<std::int64_t> ExpiryOf(const std::string& text, absl::Time now) {
  absl::string_view days = text;
  int count = 0;
  if (absl::ConsumeSuffix(&days, "d") && absl::SimpleAtoi(days, &count) && count > 0 && count <= 36500) {
    return absl::ToUnixSeconds(now + count * absl::Hours(24));
  }
  absl::Time time;
  std::string error;
  for (const char* format : {"%Y-%m-%d", "%Y-%m-%dT%H:%M:%S%Ez"}) {
    if (absl::ParseTime(format, text, absl::UTCTimeZone(), &time, &error)) return absl::ToUnixSeconds(time);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("--expires: give days (90d) or a day (2027-01-31), not \"", text, "\""));
}

absl::Status Create(const FileOf& file, const CreateOptions& options) {
  const absl::Time now = absl::Now();
  Token token;
  token.name = options.name;
  CAIRN_ASSIGN_OR_RETURN(token.right, ParseRight(options.rights));
  token.maps = absl::StrSplit(options.maps, ',');
  if (!options.expires.empty()) {
    CAIRN_ASSIGN_OR_RETURN(token.expires_unix_s, ExpiryOf(options.expires, now));
  }
  CAIRN_ASSIGN_OR_RETURN(const std::string path, file());
  SecretFile output;
  if (!options.output.empty()) CAIRN_RETURN_IF_ERROR(output.Create(options.output));
  CAIRN_ASSIGN_OR_RETURN(const std::string secret, CreateToken(path, token, absl::ToUnixSeconds(now)));
  const std::string where = options.output.empty() ? "Keep it now" : options.output;
  std::cerr << "token " << token.name << ": " << RightName(token.right) << " of " << absl::StrJoin(token.maps, ", ")
            << ". " << where << (options.output.empty() ? ": " : " has it, ") << path << " a hash of it only\n";
  if (!options.output.empty()) return output.Write(secret + "\n");
  struct stat standard = {};
  if (fstat(STDOUT_FILENO, &standard) == 0 && S_ISREG(standard.st_mode) && (standard.st_mode & 0077) != 0) {
    std::cerr << "others on this machine can read the file that it is written to: use --output FILE, or chmod 600\n";
  }
  std::cout << secret << "\n";
  return absl::OkStatus();
}

absl::Status List(const FileOf& file) {
  CAIRN_ASSIGN_OR_RETURN(const std::string path, file());
  CAIRN_ASSIGN_OR_RETURN(const std::vector<Token> tokens, ReadTokens(path));
  const std::int64_t now = absl::ToUnixSeconds(absl::Now());
  std::cout << absl::StreamFormat("%-24s %-8s %-17s %-17s %s\n", "NAME", "RIGHTS", "CREATED", "EXPIRES", "MAPS");
  for (const Token& token : tokens) {
    std::string expires = token.expires_unix_s ? DayOf(*token.expires_unix_s) : "never";
    if (token.Expired(now)) expires = "expired";
    std::cout << absl::StreamFormat("%-24s %-8s %-17s %-17s %s\n", token.name, RightName(token.right),
                                    DayOf(token.created_unix_s), expires, absl::StrJoin(token.maps, ","));
  }
  return absl::OkStatus();
}

}  // namespace

void AddTokenCommand(CLI::App& app, std::function<absl::StatusOr<std::string>()> tokens_file, TokenAction* action) {
  CLI::App* const token = app.add_subcommand("token", "Who may do what with which maps: create, list, revoke");
  token->require_subcommand(1);
  token->fallthrough();  // --tokens and --config are the server's own
  const auto file = std::make_shared<FileOf>(std::move(tokens_file));

  CLI::App* const create = token->add_subcommand("create", "Makes one and prints it, once");
  create->fallthrough();
  const auto options = std::make_shared<CreateOptions>();
  create->add_option("NAME", options->name, "Of the token, in lists and logs: a robot's, a person's")->required();
  create->add_option("--maps", options->maps, "Names of maps, with commas; * stands for any characters: 'office,lab*'")
      ->required();
  create->add_option("--rights", options->rights, "read, extend (read, and sessions that add), or admin (everything)")
      ->default_str("read");
  create->add_option("--expires", options->expires, "After so many days (90d), or on a day (2027-01-31, UTC)");
  create->add_option("--output", options->output,
                     "New file for the secret, which only its owner may read; else it is printed");
  create->callback([=] { *action = [=] { return Create(*file, *options); }; });

  CLI::App* const list = token->add_subcommand("list", "All of them");
  list->fallthrough();
  list->callback([=] { *action = [=] { return List(*file); }; });

  CLI::App* const revoke = token->add_subcommand("revoke", "Ends one at once, also at servers that are running");
  revoke->fallthrough();
  const auto name = std::make_shared<std::string>();
  revoke->add_option("NAME", *name, "Of the token")->required();
  revoke->callback([=] {
    *action = [=]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(const std::string path, (*file)());
      CAIRN_RETURN_IF_ERROR(RevokeToken(path, *name));
      std::cerr << "token " << *name << " is revoked: servers of " << path << " do not know it any more\n";
      return absl::OkStatus();
    };
  });
}

}  // namespace cairn::server
