// Everything there is to check of a stored map, as a list of what is wrong with it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/map_store.h"

namespace cairn::health {

struct VerifyOptions {
  // Beyond the store's structures, checksums, references and consistency: does the map make sense (map/plausibility.h),
  // does its vocabulary give the words that the keyframes have.
  bool deep = false;
};

struct VerifyReport {
  std::optional<store::MapSummary> summary;  // none: not even that could be read
  std::vector<store::Finding> findings;      // none: the map is good
  std::vector<std::string> notes;            // of the store: what a user should know, but no damage
  std::int64_t checked_words = 0;            // of a deep check
};

// What keeps the map from being opened is a finding as well. Errors: there is no such map, it is none, it is of a newer
// Cairn, it could not be read.
absl::StatusOr<VerifyReport> VerifyMap(const std::string& uri, const VerifyOptions& options = {});

// kDamaged if VerifyMap() would find anything: for who is about to change the map for good.
absl::Status CheckSound(const std::string& uri);

}  // namespace cairn::health
