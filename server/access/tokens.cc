#include "server/access/tokens.h"

#include <fcntl.h>
#include <sodium.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include "api/map_service.h"
#include "base/files.h"
#include "base/guarded.h"
#include "base/shown.h"

namespace cairn::server {
namespace {

using nlohmann::json;

constexpr std::array<const char*, 3> kRights = {"read", "extend", "admin"};
constexpr std::size_t kSecretBytes = 32, kHashBytes = 32;
constexpr std::uint64_t kMaxFileBytes = 16 << 20;

bool Matches(absl::string_view pattern, absl::string_view text) {
  // Where to go on if what follows the last '*' does not fit: it stands for one character more.
  std::size_t p = 0, t = 0, star = absl::string_view::npos, resume = 0;
  while (t < text.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      resume = t;
    } else if (p < pattern.size() && pattern[p] == text[t]) {
      ++p, ++t;
    } else if (star != absl::string_view::npos) {
      p = star + 1;
      t = ++resume;
    } else {
      return false;
    }
  }
  while (p < pattern.size() && pattern[p] == '*') ++p;
  return p == pattern.size();
}

bool IsPattern(const std::string& pattern) {
  constexpr absl::string_view kAllowed = "._-*";
  return !pattern.empty() && pattern.size() <= 128 && std::ranges::all_of(pattern, [&](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) || absl::StrContains(kAllowed, c);
  });
}

std::string TimeText(std::int64_t unix_s) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", absl::FromUnixSeconds(unix_s), absl::UTCTimeZone());
}

absl::StatusOr<std::int64_t> ReadTime(const std::string& text) {
  absl::Time time;
  std::string error;
  if (!absl::ParseTime(absl::RFC3339_full, text, &time, &error)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", text, "\" is no time as 2027-01-31T00:00:00Z"));
  }
  return absl::ToUnixSeconds(time);
}

absl::Status BadEntry(absl::string_view what) { return absl::InvalidArgumentError(std::string(what)); }

absl::StatusOr<std::string> TextOf(const json& entry, const char* key) {
  if (!entry.contains(key) || !entry[key].is_string()) return BadEntry(absl::StrCat("`", key, "` must be a text"));
  return entry[key].get<std::string>();
}

absl::StatusOr<Token> TokenOf(const json& entry) {
  constexpr std::array<absl::string_view, 6> kKeys = {"name", "hash", "maps", "rights", "created", "expires"};
  if (!entry.is_object()) return BadEntry("it is no object");
  for (const auto& field : entry.items()) {
    if (std::ranges::find(kKeys, field.key()) == kKeys.end()) {
      return BadEntry(absl::StrCat("there is no key `", field.key(), "`; there are ", absl::StrJoin(kKeys, ", ")));
    }
  }
  Token token;
  CAIRN_ASSIGN_OR_RETURN(token.name, TextOf(entry, "name"));
  CAIRN_ASSIGN_OR_RETURN(token.hash, TextOf(entry, "hash"));
  CAIRN_ASSIGN_OR_RETURN(const std::string right, TextOf(entry, "rights"));
  CAIRN_ASSIGN_OR_RETURN(token.right, ParseRight(right));
  CAIRN_ASSIGN_OR_RETURN(const std::string created, TextOf(entry, "created"));
  CAIRN_ASSIGN_OR_RETURN(token.created_unix_s, ReadTime(created));
  if (entry.contains("expires")) {
    CAIRN_ASSIGN_OR_RETURN(const std::string expires, TextOf(entry, "expires"));
    CAIRN_ASSIGN_OR_RETURN(token.expires_unix_s, ReadTime(expires));
  }
  if (!entry.contains("maps") || !entry["maps"].is_array()) return BadEntry("`maps` must be a list of texts");
  for (const json& pattern : entry["maps"]) {
    if (!pattern.is_string()) return BadEntry("`maps` must be a list of texts");
    token.maps.push_back(pattern.get<std::string>());
  }
  CAIRN_RETURN_IF_ERROR(token.Validate());
  return token;
}

std::string TextOfAll(const std::vector<Token>& tokens) {
  nlohmann::ordered_json entries = nlohmann::ordered_json::array();
  for (const Token& token : tokens) {
    nlohmann::ordered_json entry{{"name", token.name}, {"rights", RightName(token.right)}, {"maps", token.maps}};
    entry["created"] = TimeText(token.created_unix_s);
    if (token.expires_unix_s) entry["expires"] = TimeText(*token.expires_unix_s);
    entry["hash"] = token.hash;
    entries.push_back(std::move(entry));
  }
  return nlohmann::ordered_json{{"version", 1}, {"tokens", entries}}.dump(1) + "\n";
}

// Held by who changes files of a folder, as long as it lives.
class FolderLock {
 public:
  explicit FolderLock(const std::string& file) {
    const std::string folder = std::filesystem::path(file).parent_path().string();
    fd_ = open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd_ >= 0) flock(fd_, LOCK_EX);
  }
  ~FolderLock() {
    if (fd_ >= 0) close(fd_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int fd_ = -1;
};

absl::Status Write(const std::string& path, const std::vector<Token>& tokens) {
  return WriteFileAtomically(path, TextOfAll(tokens), /*overwrite=*/true, FilePermissions::kOwnerOnly);
}

}  // namespace

std::string RightName(Right right) { return kRights[static_cast<std::size_t>(right)]; }

absl::StatusOr<Right> ParseRight(absl::string_view name) {
  const auto* found = std::ranges::find(kRights, name);
  if (found == kRights.end()) {
    return absl::InvalidArgumentError(absl::StrCat("there are no rights `", name, "`; there are read, extend, admin"));
  }
  return static_cast<Right>(found - kRights.begin());
}

bool Token::Covers(absl::string_view map) const {
  return std::ranges::any_of(maps, [&](const std::string& pattern) { return Matches(pattern, map); });
}

absl::Status Token::Validate() const {
  if (!api::CheckMapName(name).ok()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "token: \"", Shown(name, 40),
        "\" is no name of a token: that takes letters (a to z), digits, '.', '_' and '-', 1 to 128 of them, "
        "a letter or a digit first"));
  }
  if (maps.empty()) return absl::InvalidArgumentError(absl::StrCat("token ", name, ": it names no maps"));
  for (const std::string& pattern : maps) {
    if (IsPattern(pattern)) continue;
    return absl::InvalidArgumentError(absl::StrCat("token ", name, ": \"", pattern,
                                                   "\" names no maps: letters, digits, . _ - and * for any of them"));
  }
  const bool hex = hash.size() == 2 * kHashBytes &&
                   std::ranges::all_of(hash, [](unsigned char c) { return absl::ascii_isxdigit(c); });
  if (!hex) return absl::InvalidArgumentError(absl::StrCat("token ", name, ": `hash` must be 64 hex digits"));
  return absl::OkStatus();
}

absl::StatusOr<std::string> NewTokenSecret() {
  if (sodium_init() < 0) return absl::InternalError("libsodium cannot be used: no random numbers");
  std::array<unsigned char, kSecretBytes> random;
  randombytes_buf(random.data(), random.size());
  std::array<char, sodium_base64_ENCODED_LEN(kSecretBytes, sodium_base64_VARIANT_URLSAFE_NO_PADDING)> text;
  sodium_bin2base64(text.data(), text.size(), random.data(), random.size(), sodium_base64_VARIANT_URLSAFE_NO_PADDING);
  return absl::StrCat("cairn_", text.data());
}

std::string HashOfToken(absl::string_view secret) {
  std::array<unsigned char, kHashBytes> hash;
  crypto_generichash(hash.data(), hash.size(), reinterpret_cast<const unsigned char*>(secret.data()), secret.size(),
                     nullptr, 0);
  std::array<char, 2 * kHashBytes + 1> hex;
  return sodium_bin2hex(hex.data(), hex.size(), hash.data(), hash.size());
}

absl::StatusOr<std::vector<Token>> ParseTokens(const std::string& text) {
  return Guarded([&]() -> absl::StatusOr<std::vector<Token>> {
    const json root = json::parse(text, nullptr, /*allow_exceptions=*/false);
    if (!root.is_object() || root.size() != 2 || !root.contains("version") || !root.contains("tokens") ||
        !root["tokens"].is_array()) {
      return absl::InvalidArgumentError("it is no file of tokens: {\"version\": 1, \"tokens\": [...]}");
    }
    if (root["version"] != 1) return absl::InvalidArgumentError("it is of a version that is not known here");
    std::vector<Token> tokens;
    std::set<std::string> names;
    for (const json& entry : root["tokens"]) {
      absl::StatusOr<Token> token = TokenOf(entry);
      if (!token.ok()) return Annotate(token.status(), absl::StrCat("token ", tokens.size() + 1));
      if (!names.insert(token->name).second) {
        return absl::InvalidArgumentError(absl::StrCat("there are two tokens ", token->name));
      }
      tokens.push_back(*std::move(token));
    }
    return tokens;
  });
}

absl::StatusOr<std::vector<Token>> ReadTokens(const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::string text, ReadWholeFile(path, kMaxFileBytes));
  absl::StatusOr<std::vector<Token>> tokens = ParseTokens(text);
  // What is in the file is nobody's request.
  if (!tokens.ok()) return absl::FailedPreconditionError(absl::StrCat(path, ": ", tokens.status().message()));
  return tokens;
}

absl::StatusOr<std::string> CreateToken(const std::string& path, Token token, std::int64_t now_unix_s) {
  return Guarded([&]() -> absl::StatusOr<std::string> {
    CAIRN_ASSIGN_OR_RETURN(std::string secret, NewTokenSecret());
    token.hash = HashOfToken(secret);
    token.created_unix_s = now_unix_s;
    CAIRN_RETURN_IF_ERROR(token.Validate());
    if (token.Expired(now_unix_s)) {
      return absl::InvalidArgumentError(absl::StrCat("token ", token.name, ": it would have expired already"));
    }
    const FolderLock lock(path);
    absl::StatusOr<std::vector<Token>> tokens = ReadTokens(path);
    if (absl::IsNotFound(tokens.status())) tokens = std::vector<Token>();
    CAIRN_RETURN_IF_ERROR(tokens.status());
    if (std::ranges::find(*tokens, token.name, &Token::name) != tokens->end()) {
      return absl::AlreadyExistsError(absl::StrCat("there is a token ", token.name, " already; revoke it first"));
    }
    tokens->push_back(std::move(token));
    CAIRN_RETURN_IF_ERROR(Write(path, *tokens));
    return secret;
  });
}

absl::Status RevokeToken(const std::string& path, const std::string& name) {
  return Guarded([&]() -> absl::Status {
    const FolderLock lock(path);
    CAIRN_ASSIGN_OR_RETURN(std::vector<Token> tokens, ReadTokens(path));
    if (std::erase_if(tokens, [&](const Token& token) { return token.name == name; }) == 0) {
      return absl::NotFoundError(absl::StrCat("there is no token ", name, " in ", path));
    }
    return Write(path, tokens);
  });
}

}  // namespace cairn::server
