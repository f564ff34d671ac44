// The vocabulary that ships with Cairn.
#pragma once

#include <string>

#include "base/status.h"
#include "place/vocabulary.h"

namespace cairn::place {

inline constexpr const char* kDefaultVocabularyFile = "default_vocabulary.cairnvoc";

// Path of the shipped vocabulary: `<folder of the program>/../share/cairn/`, then the source tree that the program was
// built from. NotFound listing where it looked.
absl::StatusOr<std::string> FindDefaultVocabulary();

absl::StatusOr<Vocabulary> LoadDefaultVocabulary();

}  // namespace cairn::place
