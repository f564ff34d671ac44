// SqliteMapStore::Verify.
#include <algorithm>
#include <memory>
#include <thread>
#include <utility>

#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "base/guarded.h"
#include "store/content_check.h"
#include "store/digest.h"
#include "store/free_pages.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/ready_check.h"
#include "store/sqlite.h"
#include "store/sqlite_map_store.h"
#include "store/verification.h"

namespace cairn::store {
namespace {

// Nobody looks at features once they have gone by.
class NoFeatures : public map::FeatureReader {
 public:
  absl::StatusOr<std::shared_ptr<const map::KeyframeFeatures>> Read(KeyframeId keyframe) override {
    return absl::InternalError(absl::StrCat("the features of keyframe ", keyframe.value(), " were asked for again"));
  }
};

// One part of what there is to check.
class Verification {
 public:
  explicit Verification(Database* database, OfferedWork* shared = nullptr, Database* beside = nullptr)
      : database_(database), shared_(shared), beside_(beside) {}

  // SQLite's own structures, and that rows which others refer to are there.
  absl::StatusOr<std::vector<Finding>> OfStructure() {
    absl::Status status = Absorb(CheckStructure());
    if (status.ok() && findings_.empty()) status = Absorb(CheckFreePages(database_, Sink()));
    if (status.ok()) status = Absorb(CheckReferences());
    return Result(status);
  }

  // What the tables are and say.
  absl::StatusOr<std::vector<Finding>> OfContent() {
    absl::Status status = Absorb(CheckSchema(database_, /*views=*/false, Sink()));
    if (status.ok()) status = Absorb(CheckSchema(database_, /*views=*/true, Sink()));
    if (status.ok()) status = Absorb(CheckContent());
    return Result(status);
  }

 private:
  absl::StatusOr<std::vector<Finding>> Result(const absl::Status& status) {
    if (!status.ok() && findings_.size() < kMaxFindings) return status;
    return std::move(findings_);
  }

  FindingSink Sink() {
    return [this](const Finding& finding) {
      findings_.push_back(finding);
      return findings_.size() < kMaxFindings ? absl::OkStatus() : absl::ResourceExhaustedError("too many findings");
    };
  }

  // What stops one check because the file is damaged is a finding, not a failure of checking.
  absl::Status Absorb(const absl::Status& status) {
    if (!IsDamaged(status)) return status;
    return Sink()(Finding{"", 0, std::string(status.message())});
  }

  absl::Status CheckStructure() {
    CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare("PRAGMA integrity_check(100)"));
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (!found) return absl::OkStatus();
      if (rows.Text(0) == "ok") continue;
      absl::string_view found_there = rows.Text(0);
      absl::ConsumePrefix(&found_there, "*** in database main ***\n");
      for (const absl::string_view line : absl::StrSplit(found_there, '\n', absl::SkipEmpty())) {
        CAIRN_RETURN_IF_ERROR(Sink()(Finding{"", 0, absl::StrCat("SQLite: ", line)}));
      }
    }
  }

  absl::Status CheckReferences() {
    CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare("PRAGMA foreign_key_check"));
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (!found) return absl::OkStatus();
      CAIRN_RETURN_IF_ERROR(Sink()(Finding{std::string(rows.Text(0)), rows.Int(1),
                                           absl::StrCat("refers to a missing row of table ", rows.Text(2))}));
    }
  }

  absl::Status CheckContent() {
    MapReader reader(database_, Sink());
    const std::size_t found_before = findings_.size();
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    if (findings_.size() == found_before && CanGoByRows(reader.format(), reader.map_row())) {
      return CheckContentByRows(database_, Sink(), shared_, beside_);
    }
    // Features are checked as they go by; all of them at once would take most of the memory of a large map.
    const auto cache = map::FeatureCache::Create(std::make_unique<NoFeatures>(), /*budget_bytes=*/0);
    ReadyCheck ready(database_, Sink());
    CAIRN_RETURN_IF_ERROR(ready.Begin(reader.map_row().revision));
    const auto words = [&ready](KeyframeId id, const std::vector<std::uint32_t>& of_keyframe) {
      ready.TakeWords(id, of_keyframe);
      return absl::OkStatus();
    };
    CAIRN_RETURN_IF_ERROR(reader.ReadEntities({cache.get(), words}));
    CAIRN_RETURN_IF_ERROR(reader.CheckVocabulary());
    CAIRN_RETURN_IF_ERROR(reader.CheckChanges());
    if (!findings_.empty()) return absl::OkStatus();
    const auto snapshot = reader.Assemble();
    if (!findings_.empty()) return absl::OkStatus();
    CAIRN_RETURN_IF_ERROR(snapshot.status());
    const absl::Status consistent = (*snapshot)->CheckConsistency();
    if (!consistent.ok()) return Sink()(Finding{"", 0, std::string(consistent.message())});
    return ready.Finish(**snapshot);
  }

  Database* database_;
  OfferedWork* shared_;
  Database* beside_;
  std::vector<Finding> findings_;
};

}  // namespace

absl::StatusOr<std::vector<Finding>> VerifyDatabase(Database* database, Database* beside) {
  absl::StatusOr<std::vector<Finding>> structure = absl::InternalError("not looked at");
  absl::StatusOr<std::thread> thread = absl::UnavailableError("no connection");
  OfferedWork shared;
  const auto failed = [&](const absl::Status& status) { structure = status; };
  const auto look = [&] {
    const auto transaction = Transaction::Begin(beside, Transaction::Kind::kRead);
    if (!transaction.ok()) return failed(transaction.status());
    structure = Verification(beside).OfStructure();
    if (structure.ok()) shared.Help();
  };
  if (beside != nullptr) thread = StartThread("checking the file's structure", look, failed);
  absl::StatusOr<std::vector<Finding>> content =
      Guarded([&] { return Verification(database, thread.ok() ? &shared : nullptr, beside).OfContent(); });
  if (thread.ok()) {
    shared.End();
    thread->join();
  } else {
    structure = Verification(database).OfStructure();
  }
  CAIRN_RETURN_IF_ERROR(structure.status());
  CAIRN_RETURN_IF_ERROR(content.status());
  std::vector<Finding> findings = *std::move(structure);
  const std::size_t room = kMaxFindings - std::min(kMaxFindings, findings.size());
  findings.insert(findings.end(), content->begin(),
                  content->begin() + static_cast<std::ptrdiff_t>(std::min(room, content->size())));
  return findings;
}

absl::Status StatusOf(const std::vector<Finding>& findings) {
  if (findings.empty()) return absl::OkStatus();
  const absl::string_view at_least = findings.size() < kMaxFindings ? "" : " at least";
  const std::string more =
      findings.size() > 1 ? absl::StrCat(", and", at_least, " ", findings.size() - 1, " more findings") : "";
  return MakeFault(Fault::kDamaged, absl::StrCat(DamagedBy(findings[0]).message(), more,
                                                 " (cairn verify lists them, cairn recover saves what is good)"));
}

absl::StatusOr<std::vector<Finding>> SqliteMapStore::Verify() {
  auto verified = [&]() -> absl::StatusOr<std::vector<Finding>> {
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    std::string stamp;
    const auto beside = OpenForReading(resolved_, &stamp);
    const bool same_file = beside.ok() && identity_.IsAt(resolved_);
    CAIRN_ASSIGN_OR_RETURN(auto findings, VerifyDatabase(database_.get(), same_file ? beside->get() : nullptr));
    if (!log_damage_.empty()) findings.push_back({"", 0, log_damage_});
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return findings;
  }();
  if (!verified.ok()) return Annotated(verified.status());
  return verified;
}

}  // namespace cairn::store
