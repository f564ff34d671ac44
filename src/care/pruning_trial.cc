#include "care/pruning_trial.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <optional>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "store/file_paths.h"
#include "store/map_overview.h"
#include "store/map_store.h"

namespace cairn::care {
namespace {

constexpr int kMaxTrials = 6;
constexpr absl::string_view kSuffix = ".cairn";
constexpr double kGoodEnough = 0.005;  // of the budget that is left unused

void RemoveAt(const std::string& trial) {
  std::error_code error;
  std::filesystem::remove(trial, error);
  store::RemoveCompanions(trial);
  std::filesystem::remove(absl::StrCat(trial, store::kLockSuffix), error);
}

// A name for copies beside the map; what was made there goes when this does, and what processes left there that were
// killed, when this comes.
class TrialFile {
 public:
  explicit TrialFile(const std::string& map) {
    const std::filesystem::path path(map);
    const std::string names = absl::StrCat(".", path.stem().string(), "-trial-");
    path_ = (path.parent_path() / absl::StrCat(names, getpid(), kSuffix)).string();
    std::error_code error;
    const auto folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      const std::string name = entry.path().filename().string();
      absl::string_view number = name;
      pid_t process = 0;
      const bool is_trial = absl::ConsumePrefix(&number, names) && absl::ConsumeSuffix(&number, kSuffix) &&
                            absl::SimpleAtoi(number, &process) && process > 0;
      if (is_trial && kill(process, 0) != 0 && errno == ESRCH) RemoveAt(entry.path().string());
    }
  }
  ~TrialFile() { Remove(); }
  TrialFile(const TrialFile&) = delete;
  TrialFile& operator=(const TrialFile&) = delete;

  void Remove() const { RemoveAt(path_); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

absl::StatusOr<std::int64_t> BytesAfter(const std::string& path, const map::Delta& delta) {
  const TrialFile trial(path);
  trial.Remove();
  CAIRN_ASSIGN_OR_RETURN(const auto map, store::OpenMapStore(path, store::OpenMode::kRead));
  CAIRN_RETURN_IF_ERROR(map->CopyTo(trial.path()));
  // Opened twice, as by who prunes: what is kept ready is brought up to date when a writer closes.
  CAIRN_ASSIGN_OR_RETURN(const auto changed, store::OpenMapStore(trial.path(), store::OpenMode::kWrite));
  if (!delta.empty()) CAIRN_RETURN_IF_ERROR(changed->Commit(delta));
  CAIRN_RETURN_IF_ERROR(changed->Close());
  CAIRN_ASSIGN_OR_RETURN(const auto compacted, store::OpenMapStore(trial.path(), store::OpenMode::kWrite));
  CAIRN_RETURN_IF_ERROR(compacted->Compact());
  CAIRN_ASSIGN_OR_RETURN(const store::MapSummary summary, compacted->ReadSummary());
  CAIRN_RETURN_IF_ERROR(compacted->Close());
  return summary.file_bytes;
}

}  // namespace

absl::StatusOr<PrunePlan> TryPruning(const std::string& path, const std::shared_ptr<const map::Snapshot>& map,
                                     const PruneOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_ASSIGN_OR_RETURN(const store::MapOverview overview, store::ReadMapOverview(path));
  if (!options.budget_bytes) {
    CAIRN_ASSIGN_OR_RETURN(PrunePlan plan, PlanPruning(map, overview, options));
    CAIRN_ASSIGN_OR_RETURN(plan.bytes_after, BytesAfter(path, plan.delta));
    return plan;
  }
  const std::int64_t budget = *options.budget_bytes;
  std::optional<PrunePlan> best;
  std::int64_t smallest = overview.summary.file_bytes, keyframes_before = -1;
  PruneOptions aim = options;
  aim.as_far_as_possible = true;
  for (int trial = 0; trial<kMaxTrials&& * aim.budget_bytes> 0; ++trial) {
    CAIRN_ASSIGN_OR_RETURN(PrunePlan plan, PlanPruning(map, overview, aim));
    if (plan.keyframes == keyframes_before) break;  // there is nothing in between, or nothing more that may go
    keyframes_before = plan.keyframes;
    const std::int64_t estimated = plan.bytes_after;
    CAIRN_ASSIGN_OR_RETURN(plan.bytes_after, BytesAfter(path, plan.delta));
    smallest = std::min(smallest, plan.bytes_after);
    const std::int64_t left = budget - plan.bytes_after;
    const bool all_stays = plan.delta.empty();
    if (left >= 0 && (!best || plan.bytes_after > best->bytes_after)) best = std::move(plan);
    if (left >= 0 && (all_stays || static_cast<double>(left) < kGoodEnough * static_cast<double>(budget))) break;
    // By as much as this was wrong, the next will be; a little less, as it must not be over again.
    aim.budget_bytes = estimated + left - static_cast<std::int64_t>(0.2 * kGoodEnough * static_cast<double>(budget));
  }
  if (best) return *std::move(best);
  return absl::FailedPreconditionError(absl::StrFormat(
      "it cannot be made smaller than %.2f MB without losing whole components or more than all "
      "redundancy: of that %.2f MB are the vocabulary; see also cairn pack --localization-only",
      static_cast<double>(smallest) / 1e6, static_cast<double>(overview.summary.vocabulary_bytes) / 1e6));
}

}  // namespace cairn::care
