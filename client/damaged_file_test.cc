// Files that are cut off, overwritten and zeroed anywhere: whoever opens, asks, looks at and checks such a map gets the
// right answer or a clear message, and `recover` brings back every keyframe whose rows are whole.
//
// CAIRN_DAMAGES: how many damages instead of the few of a test run. CAIRN_DAMAGED_MAP: the file to damage (a copy of),
// instead of a map of a rendered room.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <map>

#include "base/random.h"
#include "client/conformance/conformance_map.h"
#include "client/local_localizer.h"
#include "health/recover_map.h"
#include "health/verify_map.h"
#include "store/map_overview.h"
#include "store/sqlite.h"
#include "store/testing_files.h"

namespace cairn::client {
namespace {

using ::testing::HasSubstr;

// Where the rows of a table lie in a file without damage (https://www.sqlite.org/fileformat2.html, 1.5 and 1.6), found
// without any of the code that is tested.
class RowPlaces {
 public:
  struct Range {
    std::size_t begin, size;
  };
  using Rows = std::map<std::uint32_t, std::vector<Range>>;  // by id

  explicit RowPlaces(const std::string& bytes) : bytes_(bytes), page_bytes_(Big(16, 2) == 1 ? 65536 : Big(16, 2)) {}

  std::size_t page_bytes() const { return page_bytes_; }

  Rows Of(std::size_t root) const {
    Rows rows;
    Walk(root, &rows);
    return rows;
  }

 private:
  std::size_t Big(std::size_t at, int size) const {
    std::size_t value = 0;
    for (int i = 0; i < size; ++i) value = value << 8 | static_cast<std::uint8_t>(bytes_.at(at + i));
    return value;
  }
  std::size_t Varint(std::size_t* at) const {
    std::size_t value = 0;
    for (int i = 0; i < 9; ++i) {
      const auto byte = static_cast<std::uint8_t>(bytes_.at((*at)++));
      if (i == 8) return value << 8 | byte;
      value = value << 7 | (byte & 0x7f);
      if (byte < 0x80) break;
    }
    return value;
  }

  void Walk(std::size_t page, Rows* rows) const {
    const std::size_t begin = (page - 1) * page_bytes_, header = begin + (page == 1 ? 100 : 0);
    const std::size_t cells = Big(header + 3, 2);
    const bool leaf = bytes_.at(header) == 0x0d;
    const std::size_t pointers = header + (leaf ? 8 : 12);
    for (std::size_t i = 0; i < cells; ++i) {
      const std::size_t cell = begin + Big(pointers + 2 * i, 2);
      if (!leaf) {
        Walk(Big(cell, 4), rows);
        continue;
      }
      std::size_t at = cell;
      const std::size_t size = Varint(&at);
      const std::size_t id = Varint(&at);
      std::vector<Range>& ranges = (*rows)[static_cast<std::uint32_t>(id)];
      ranges.push_back({header, pointers + 2 * cells - header});
      AddPayload(cell, at, size, &ranges);
    }
    if (!leaf) Walk(Big(header + 8, 4), rows);
  }

  void AddPayload(std::size_t cell, std::size_t at, std::size_t size, std::vector<Range>* ranges) const {
    const std::size_t most = page_bytes_ - 35, least = (page_bytes_ - 12) * 32 / 255 - 23;
    std::size_t local = size;
    if (size > most) {
      const std::size_t rest = least + (size - least) % (page_bytes_ - 4);
      local = rest <= most ? rest : least;
    }
    ranges->push_back({cell, at + local - cell + (local < size ? 4 : 0)});
    std::size_t next = local < size ? Big(at + local, 4) : 0;
    for (std::size_t left = size - local; left > 0;) {
      const std::size_t here = std::min(left, page_bytes_ - 4), begin = (next - 1) * page_bytes_;
      ranges->push_back({begin, here + 4});
      left -= here;
      next = Big(begin, 4);
    }
  }

  const std::string& bytes_;
  const std::size_t page_bytes_;
};

class DamagedFile : public ::testing::Test {
 protected:
  void SetUp() override {
    const char* real = std::getenv("CAIRN_DAMAGED_MAP");
    if (real != nullptr) {
      std::filesystem::copy_file(real, path_);
    } else {
      ASSERT_TRUE(conformance::WriteConformanceMap(path_).ok());
    }
    original_ = store::testing::ReadBytes(path_);
    map_ = store::testing::LoadMap(path_);
    digest_ = *(*store::OpenMapStore(path_, store::OpenMode::kRead))->ContentDigest();
    const RowPlaces places(original_);
    page_bytes_ = places.page_bytes();
    const auto database = *store::Database::OpenFile(path_, store::Database::Mode::kReadOnly);
    for (const char* table : {"keyframes", "keyframe_features", "keyframe_points"}) {
      const std::string sql = absl::StrCat("SELECT rootpage FROM sqlite_master WHERE name = '", table, "'");
      for (auto& [id, ranges] : places.Of(static_cast<std::size_t>(*database->QueryInt(sql)))) {
        auto& all = places_[id];
        all.insert(all.end(), ranges.begin(), ranges.end());
      }
    }
    ASSERT_EQ(places_.size(), map_->keyframes().size());
    expected_ = Locate();
    ASSERT_TRUE(expected_.ok()) << expected_.status();
    ASSERT_TRUE(real != nullptr || expected_->localized) << expected_->reason;
  }

  absl::StatusOr<api::LocalizeAnswer> Locate() const {
    const conformance::ConformanceMap& map = conformance::TheConformanceMap();
    static const api::LocalizeQuery query{map.room.Render(map.pinhole, conformance::LookInRoom({0.2, 0.0, -1.4}, 0.05)),
                                          Camera::FromPinhole(map.pinhole), 0};
    CAIRN_ASSIGN_OR_RETURN(const auto localizer, LocalLocalizer::Open(path_));
    return localizer->Localize(query);
  }

  // One of the three kinds; says which.
  std::string Damage(int trial, Random* random, std::string* bytes) const {
    const std::size_t size = bytes->size();
    switch (trial % 3) {
      case 0: {
        bytes->resize(random->Below(size));
        return absl::StrCat("cut off after ", bytes->size(), " bytes");
      }
      case 1: {
        // From a few bytes to several pages.
        const std::size_t most = std::size_t{1} << (2 + random->Below(14));
        const std::size_t begin = random->Below(size), count = std::min(size - begin, 1 + random->Below(most));
        for (std::size_t i = begin; i < begin + count; ++i) (*bytes)[i] = static_cast<char>(random->Below(256));
        return absl::StrCat(count, " random bytes from ", begin, " on");
      }
      default: {
        const std::size_t page = random->Below(size / page_bytes_);
        bytes->replace(page * page_bytes_, page_bytes_, page_bytes_, '\0');
        return absl::StrCat("page ", page + 1, " is zeros");
      }
    }
  }

  std::vector<KeyframeId> Intact(const std::string& bytes) const {
    std::vector<KeyframeId> intact;
    for (const auto& [id, ranges] : places_) {
      const bool whole = std::ranges::all_of(ranges, [&](const RowPlaces::Range& range) {
        return range.begin + range.size <= bytes.size() &&
               bytes.compare(range.begin, range.size, original_, range.begin, range.size) == 0;
      });
      if (whole) intact.emplace_back(id);
    }
    return intact;
  }

  void Remove(const std::string& path) const {
    for (const char* suffix : {"", "-wal", "-shm", "-lock"}) std::filesystem::remove(path + suffix);
  }

  void ExpectClear(const absl::Status& status) const {
    if (status.ok()) return;
    EXPECT_THAT(status.message(), HasSubstr(path_));
    EXPECT_NE(store::FaultOf(status), store::Fault::kNone) << status;
  }

  // The right answer, or a message.
  void ExpectNoOtherAnswer() const {
    const absl::StatusOr<api::LocalizeAnswer> answer = Locate();
    ExpectClear(answer.status());
    if (answer.ok()) {
      EXPECT_EQ(answer->localized, expected_->localized) << answer->reason;
      EXPECT_EQ(answer->world_from_camera.Matrix(), expected_->world_from_camera.Matrix());
      EXPECT_EQ(answer->counts.inliers, expected_->counts.inliers);
    }
    const auto verified = health::VerifyMap(path_);
    ExpectClear(verified.status());
    const bool good = verified.ok() && verified->findings.empty();
    EXPECT_TRUE(answer.ok() || !good) << "verify does not find what is wrong: " << answer.status();
    if (good) {
      const auto store = store::OpenMapStore(path_, store::OpenMode::kRead);
      ASSERT_TRUE(store.ok()) << store.status();
      EXPECT_EQ(*(*store)->ContentDigest(), digest_) << "verify finds nothing wrong";
    }
    ExpectClear(store::ReadMapOverview(path_).status());
  }

  void ExpectAllBack(const std::vector<KeyframeId>& intact) const {
    const auto report = health::RecoverMap(path_, good_);
    ExpectClear(report.status());
    if (!report.ok()) {
      EXPECT_TRUE(intact.empty()) << intact.size() << " keyframes are whole: " << report.status();
      return;
    }
    const auto recovered = store::testing::LoadMap(good_);
    for (const KeyframeId id : intact) {
      const map::Keyframe* keyframe = recovered->keyframes().Find(id);
      if (keyframe == nullptr) {
        ADD_FAILURE() << "keyframe " << id.value() << " is whole, and lost";
        continue;
      }
      EXPECT_EQ(*keyframe->features, *map_->keyframe(id).features);
      EXPECT_EQ(keyframe->camera_from_map.Matrix(), map_->keyframe(id).camera_from_map.Matrix());
    }
  }

  const store::testing::TempFolder folder_;
  const std::string path_ = folder_.File("damaged.cairn"), good_ = folder_.File("good.cairn");
  std::string original_, digest_;
  std::shared_ptr<const map::Snapshot> map_;
  std::size_t page_bytes_ = 0;
  RowPlaces::Rows places_;
  absl::StatusOr<api::LocalizeAnswer> expected_;
};

// As where a damaged page of a tree leads SQLite past it: it finds no row, and nothing wrong.
TEST_F(DamagedFile, ARowThatIsNotFoundIsNoReasonToAnswerWithoutIt) {
  {
    const auto database = *store::Database::OpenFile(path_, store::Database::Mode::kReadWrite);
    ASSERT_TRUE(database->Execute("PRAGMA foreign_keys = OFF; DELETE FROM keyframe_features").ok());
    ASSERT_TRUE(database->Close().ok());
  }
  const absl::StatusOr<api::LocalizeAnswer> answer = Locate();
  EXPECT_EQ(store::FaultOf(answer.status()), store::Fault::kDamaged) << answer.status();
  EXPECT_THAT(answer.status().message(), HasSubstr("no row for the keyframe"));
}

TEST_F(DamagedFile, GivesTheRightAnswerOrAClearMessageAndEveryKeyframeThatIsWhole) {
  const char* wanted = std::getenv("CAIRN_DAMAGES");
  const int trials = wanted != nullptr ? std::atoi(wanted) : 45;
  Random random(15);
  std::size_t whole = 0;
  for (int trial = 0; trial < trials; ++trial) {
    std::string bytes = original_;
    const std::string what = Damage(trial, &random, &bytes);
    SCOPED_TRACE(what);
    Remove(path_);
    Remove(good_);
    store::testing::WriteBytes(path_, bytes);
    ExpectNoOtherAnswer();
    const std::vector<KeyframeId> intact = Intact(bytes);
    whole += intact.size();
    ExpectAllBack(intact);
  }
  std::printf("%d damages, %.1f %% of the keyframes were whole\n", trials,
              100.0 * static_cast<double>(whole) / static_cast<double>(trials * places_.size()));
}

}  // namespace
}  // namespace cairn::client
