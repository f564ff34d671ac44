#include "map/table.h"

#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "base/ids.h"
#include "base/random.h"

namespace cairn::map {
namespace {

using IntTable = Table<PointId, int>;

std::vector<int> Values(const IntTable& table) {
  std::vector<int> values;
  table.ForEach([&](const IntTable::Pointer& value) { values.push_back(*value); });
  return values;
}

TEST(Table, FindsWhatWasSet) {
  IntTable table;
  EXPECT_TRUE(table.empty());
  EXPECT_EQ(table.Find(PointId(5)), nullptr);
  const TableEdit edit;
  for (const PointId::Value id : {1u, 31u, 32u, 1023u, 1024u, 4000000000u}) {
    table.Set(PointId(id), std::make_shared<const int>(static_cast<int>(id % 1000)), edit);
  }
  EXPECT_EQ(table.size(), 6u);
  EXPECT_EQ(*table.Find(PointId(32)), 32);
  EXPECT_EQ(*table.Find(PointId(4000000000u)), 0);
  EXPECT_EQ(table.Find(PointId(33)), nullptr);
  EXPECT_EQ(table.Find(PointId(4294967295u)), nullptr);
  EXPECT_EQ(Values(table), (std::vector<int>{1, 31, 32, 23, 24, 0})) << "in the order of ids";
}

TEST(Table, CopiesNeverChange) {
  IntTable first;
  first.Set(PointId(7), std::make_shared<const int>(1), TableEdit());
  IntTable second = first;
  second.Set(PointId(7), std::make_shared<const int>(2), TableEdit());
  second.Set(PointId(70), std::make_shared<const int>(3), TableEdit());
  IntTable third = second;
  third.Set(PointId(7), nullptr, TableEdit());
  EXPECT_EQ(Values(first), (std::vector<int>{1}));
  EXPECT_EQ(Values(second), (std::vector<int>{2, 3}));
  EXPECT_EQ(Values(third), (std::vector<int>{3}));
  EXPECT_EQ(third.size(), 1u);
}

TEST(Table, RemovingWhatIsNotThereChangesNothing) {
  IntTable table;
  table.Set(PointId(5), nullptr, TableEdit());
  EXPECT_TRUE(table.empty());
  table.Set(PointId(5), std::make_shared<const int>(1), TableEdit());
  table.Set(PointId(500), nullptr, TableEdit());
  EXPECT_EQ(table.size(), 1u);
}

// The same edits as on a std::map; every tenth version is kept and compared at the end.
TEST(Table, AgreesWithAMapOverManyEdits) {
  Random random(1);
  IntTable table;
  std::map<PointId::Value, int> model;
  std::vector<std::pair<IntTable, std::map<PointId::Value, int>>> versions;
  for (int batch = 0; batch < 100; ++batch) {
    const TableEdit edit;
    for (int i = 0; i < 30; ++i) {
      const auto id = static_cast<PointId::Value>(1 + random.Below(3000));
      if (random.Uniform() < 0.3) {
        table.Set(PointId(id), nullptr, edit);
        model.erase(id);
      } else {
        table.Set(PointId(id), std::make_shared<const int>(batch * 100 + i), edit);
        model[id] = batch * 100 + i;
      }
    }
    if (batch % 10 == 0) versions.emplace_back(table, model);
  }
  for (const auto& [version, expected] : versions) {
    EXPECT_EQ(version.size(), expected.size());
    std::vector<int> values;
    for (const auto& [id, value] : expected) values.push_back(value);
    EXPECT_EQ(Values(version), values);
  }
  // What any two of them differ in, also those of different depths.
  versions.insert(versions.begin(), {IntTable(), {}});
  for (const auto& [before, old_values] : versions) {
    for (const auto& [after, new_values] : versions) {
      std::vector<int> expected_put, put;
      int removed = 0;
      for (const auto& [id, value] : new_values) {
        if (!old_values.contains(id) || old_values.at(id) != value) expected_put.push_back(value);
      }
      before.ForEachDifference(after, [&](const IntTable::Pointer& was, const IntTable::Pointer& is) {
        if (is != nullptr) put.push_back(*is);
        if (is == nullptr && was != nullptr) ++removed;
      });
      EXPECT_EQ(put, expected_put);
      EXPECT_EQ(static_cast<std::ptrdiff_t>(removed),
                std::ranges::count_if(old_values, [&](const auto& old) { return !new_values.contains(old.first); }));
    }
  }
}

TEST(Table, ADifferenceCostsWhatWasChanged) {
  IntTable before;
  const TableEdit made;
  for (PointId::Value id = 1; id <= 100000; ++id) before.Set(PointId(id), std::make_shared<const int>(1), made);
  IntTable after = before;
  after.Set(PointId(77777), std::make_shared<const int>(2), TableEdit());
  int visits = 0;
  before.ForEachDifference(after, [&](const auto&, const auto& is) {
    ++visits;
    EXPECT_EQ(*is, 2);
  });
  EXPECT_EQ(visits, 1);
}

// Even ids below `end`, each its own value; counts looks.
class EvenNumbers : public TableSource<int> {
 public:
  explicit EvenNumbers(std::uint32_t end) : values_(end) {
    for (std::uint32_t id = 2; id < end; id += 2) values_[id] = std::make_shared<const int>(static_cast<int>(id));
  }
  std::size_t size() const override { return (values_.size() - 1) / 2; }
  std::uint32_t end() const override { return static_cast<std::uint32_t>(values_.size()); }
  const void* content() const override { return nullptr; }  // all hold the same
  const std::shared_ptr<const int>& Find(std::uint32_t id) const override {
    static const std::shared_ptr<const int> none;
    ++looks;
    return id < values_.size() ? values_[id] : none;
  }
  mutable int looks = 0;

 private:
  std::vector<std::shared_ptr<const int>> values_;
};

TEST(Table, OverASourceHoldsWhatChangedAndLooksUpTheRest) {
  const auto source = std::make_shared<const EvenNumbers>(10001);
  const IntTable base = IntTable::Over(source);
  EXPECT_EQ(base.size(), 5000u);
  EXPECT_EQ(source->looks, 0);
  EXPECT_EQ(*base.Find(PointId(10000)), 10000);
  EXPECT_EQ(base.Find(PointId(4711)), nullptr);
  EXPECT_EQ(base.Find(PointId(20000)), nullptr);

  IntTable changed = base;
  const TableEdit edit;
  changed.Set(PointId(64), nullptr, edit);
  changed.Set(PointId(65), std::make_shared<const int>(-65), edit);
  changed.Set(PointId(9000), std::make_shared<const int>(-9000), edit);
  changed.Set(PointId(40000), std::make_shared<const int>(-40000), edit);
  EXPECT_EQ(changed.size(), 5001u);
  EXPECT_EQ(changed.Find(PointId(64)), nullptr);
  EXPECT_EQ(*changed.Find(PointId(65)), -65);
  EXPECT_EQ(*changed.Find(PointId(66)), 66) << "of the same leaf";
  EXPECT_EQ(*changed.Find(PointId(8)), 8);
  EXPECT_EQ(*base.Find(PointId(64)), 64);

  std::vector<int> expected = Values(base);
  ASSERT_EQ(expected.size(), 5000u);
  expected[31] = -65;
  expected[4499] = -9000;
  expected.push_back(-40000);
  const std::vector<int> all = Values(changed);
  EXPECT_EQ(all, expected);

  std::vector<int> differences;
  changed.ForEachDifference(base, [&](const auto& here, const auto& there) {
    differences.push_back(here ? *here : 0);
    differences.push_back(there ? *there : 0);
  });
  EXPECT_EQ(differences, (std::vector<int>{0, 64, -65, 0, -9000, 9000, -40000, 0}));
  const auto same = std::make_shared<const EvenNumbers>(10001);
  changed.WithSource(same).ForEachDifference(changed, [](const auto&, const auto&) { FAIL() << "the same"; });
  EXPECT_EQ(same->looks, 0);
  EXPECT_EQ(Values(changed.WithSource(same)), all);
}

}  // namespace
}  // namespace cairn::map
