// store/recover.h with the vocabulary that ships with Cairn at hand.
#pragma once

#include <string>

#include "store/recover.h"

namespace cairn::health {

absl::StatusOr<store::RecoverReport> RecoverMap(const std::string& bad, const std::string& good);

}  // namespace cairn::health
