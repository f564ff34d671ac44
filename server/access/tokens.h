// Tokens: who may do what with which maps. A token is 256 random bits that its holder keeps; the file has a hash of it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::server {

// Each includes those before it.
enum class Right {
  kRead,    // describe, localize, track, follow
  kExtend,  // sessions that extend a map, or make one
  kAdmin,   // everything else that changes a map: align, snapshot, delete, restore, ...
};

std::string RightName(Right right);  // "read", "extend", "admin"
absl::StatusOr<Right> ParseRight(absl::string_view name);

struct Token {
  std::string name;               // as a map's (api::CheckMapName)
  std::string hash;               // HashOfToken(), 64 hex digits
  std::vector<std::string> maps;  // names; '*' stands for any characters
  Right right = Right::kRead;
  std::int64_t created_unix_s = 0;
  std::optional<std::int64_t> expires_unix_s;

  bool Expired(std::int64_t now_unix_s) const { return expires_unix_s && now_unix_s >= *expires_unix_s; }
  bool Covers(absl::string_view map) const;
  bool CoversAll() const { return Covers("*"); }  // which is no name: only "*" does
  absl::Status Validate() const;
};

// "cairn_" and 43 characters: 256 random bits in base64 for URLs.
absl::StatusOr<std::string> NewTokenSecret();

// BLAKE2b-256 in hex. One round of a fast hash is right here, unlike for passwords: 256 random bits cannot be guessed
// from their hash however fast it is tried, and every request has to be hashed.
std::string HashOfToken(absl::string_view secret);

// The file of tokens, JSON. Errors name it and say what is wrong; unknown keys are errors.
absl::StatusOr<std::vector<Token>> ReadTokens(const std::string& path);
absl::StatusOr<std::vector<Token>> ParseTokens(const std::string& text);

// Changes of the file: atomic, readable by its owner only, one after the other also between processes. Running servers
// notice. The file need not exist before the first; made by root it belongs to whom its folder belongs to.
//
// Gives the secret, which is nowhere else. `token`: without hash and times of creation. AlreadyExists if there is one
// of its name.
absl::StatusOr<std::string> CreateToken(const std::string& path, Token token, std::int64_t now_unix_s);
// NotFound if there is none of this name.
absl::Status RevokeToken(const std::string& path, const std::string& name);

}  // namespace cairn::server
