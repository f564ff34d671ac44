#include "store/ready_keyframe_check.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "store/each_row.h"
#include "store/map_reader.h"
#include "store/ready_check.h"

namespace cairn::store {
namespace {

class ReadyKeyframeCheck {
 public:
  ReadyKeyframeCheck(Database* database, std::span<const CheckedKeyframe> keyframes, const FindingSink& sink)
      : database_(database), keyframes_(keyframes), sink_(sink), observed_points_(database) {}

  absl::Status Run() {
    for (const CheckedKeyframe& known : keyframes_) {
      if (known.parent) children_.emplace_back(known.parent, known.head.id);
    }
    std::sort(children_.begin(), children_.end());
    CAIRN_ASSIGN_OR_RETURN(
        edges_, database_->Prepare(kCovisibilityTable.SelectSql("WHERE keyframe_a = ?1 OR keyframe_b = ?1")));
    const auto report = [&](absl::string_view table, std::int64_t id, absl::string_view message) {
      return sink_(Finding{std::string(table), id, std::string(message)});
    };
    CAIRN_RETURN_IF_ERROR(ForEachChecked<map::Keyframe>(
        database_, kKeyframesTable, kNewestFormat, report,
        [&](map::Keyframe&& keyframe) { return Take(std::make_shared<map::Keyframe>(std::move(keyframe))); }));
    return CheckPage();
  }

 private:
  absl::Status Take(std::shared_ptr<map::Keyframe> keyframe) {
    const CheckedKeyframe* known = FindKeyframe(keyframes_, keyframe->id.value());
    if (known == nullptr) return absl::OkStatus();
    if (keyframe->id.value() / kKeyframesPerPage != page_) {
      CAIRN_RETURN_IF_ERROR(CheckPage());
      page_ = keyframe->id.value() / kKeyframesPerPage;
    }
    CAIRN_ASSIGN_OR_RETURN(keyframe->points, observed_points_.Of(*known));
    CAIRN_RETURN_IF_ERROR(AddNeighbours(keyframe.get()));
    const auto [begin, end] =
        std::equal_range(children_.begin(), children_.end(), std::pair(keyframe->id, KeyframeId()),
                         [](const auto& a, const auto& b) { return a.first < b.first; });
    for (auto child = begin; child != end; ++child) keyframe->children.push_back(child->second);
    of_page_.push_back(std::move(keyframe));
    return absl::OkStatus();
  }

  absl::Status AddNeighbours(map::Keyframe* keyframe) {
    edges_.Bind(1, static_cast<std::int64_t>(keyframe->id.value()));
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, edges_.Step());
      if (!found) break;
      EdgeRow edge;
      CAIRN_RETURN_IF_ERROR(ReadChecked(edges_, &row_, &edge));
      keyframe->covisible.push_back({edge.a == keyframe->id ? edge.b : edge.a, edge.shared_points});
    }
    SortCovisible(keyframe);
    return absl::OkStatus();
  }

  absl::Status CheckPage() {
    std::vector<const map::Keyframe*> keyframes;
    for (const auto& keyframe : of_page_) keyframes.push_back(keyframe.get());
    const absl::Status checked = keyframes.empty() ? absl::OkStatus()
                                                   : CheckReadyPage(database_, sink_, ReadyKind::kKeyframes, page_,
                                                                    PackReadyKeyframes(keyframes));
    of_page_.clear();
    return checked;
  }

  Database* database_;
  const std::span<const CheckedKeyframe> keyframes_;
  const FindingSink& sink_;
  ObservedPoints observed_points_;
  std::vector<std::pair<KeyframeId, KeyframeId>> children_;  // behind their parents
  Statement edges_;
  Row row_;
  std::vector<std::shared_ptr<map::Keyframe>> of_page_;
  std::uint32_t page_ = 0;
};

}  // namespace

absl::Status CheckReadyKeyframes(Database* database, std::span<const CheckedKeyframe> keyframes,
                                 const FindingSink& sink) {
  return ReadyKeyframeCheck(database, keyframes, sink).Run();
}

}  // namespace cairn::store
