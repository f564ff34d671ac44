// The head of a map that lives in a test.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mapping/feature_mapper.h"
#include "mapping/map_head.h"

namespace cairn::mapping::testing {

class TestHead : public MapHead {
 public:
  // `vocabulary` is not owned, and may be null.
  explicit TestHead(std::shared_ptr<const map::Snapshot> map, const place::Vocabulary* vocabulary = nullptr)
      : view_(*tracking::MapView::Create(
            std::move(map), vocabulary == nullptr
                                ? nullptr
                                : std::shared_ptr<const place::Vocabulary>(std::shared_ptr<void>(), vocabulary))) {}

  const std::shared_ptr<const tracking::MapView>& View() const override { return view_; }

  absl::Status Commit(map::Delta delta, const KeyframeScales& scales) override {
    if (!fail_with.ok()) return fail_with;
    CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const tracking::MapView> next, view_->After(delta));
    const auto before = std::exchange(view_, next);
    reasons.push_back(delta.reason);
    for (FeatureMapper* mapper : mappers) mapper->OnChange(*before, delta, next, scales);
    return absl::OkStatus();
  }

  const std::shared_ptr<const map::Snapshot>& map() const { return view_->snapshot(); }

  std::vector<FeatureMapper*> mappers;  // that are told of changes
  std::vector<std::string> reasons;     // of the changes
  absl::Status fail_with;               // of all further ones

 private:
  std::shared_ptr<const tracking::MapView> view_;
};

}  // namespace cairn::mapping::testing
