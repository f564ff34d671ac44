#include "place/default_vocabulary.h"

#include <filesystem>
#include <system_error>
#include <vector>

namespace cairn::place {

absl::StatusOr<std::string> FindDefaultVocabulary() {
  namespace fs = std::filesystem;
  std::vector<fs::path> candidates;
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (!error) {
    candidates.push_back(program.parent_path().parent_path() / "share" / "cairn" / kDefaultVocabularyFile);
  }
  candidates.push_back(fs::path(CAIRN_SOURCE_DATA_DIR) / kDefaultVocabularyFile);
  std::string looked;
  for (const fs::path& candidate : candidates) {
    if (fs::is_regular_file(candidate, error)) return candidate.string();
    absl::StrAppend(&looked, looked.empty() ? "" : ", ", candidate.string());
  }
  return absl::NotFoundError(
      absl::StrCat("the default vocabulary is missing; looked for ", looked, "; reinstall Cairn or name a vocabulary"));
}

absl::StatusOr<Vocabulary> LoadDefaultVocabulary() {
  CAIRN_ASSIGN_OR_RETURN(const std::string path, FindDefaultVocabulary());
  return Vocabulary::Load(path);
}

}  // namespace cairn::place
