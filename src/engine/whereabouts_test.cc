#include "engine/whereabouts.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "map/edit.h"

namespace cairn::engine {
namespace {

// Component 1 by session 1; 2 and 3 by session 2, of which the notes are.
std::shared_ptr<const map::Snapshot> TwoSessions() {
  map::MapInfo info;
  info.id = std::string(32, '3');
  auto empty = map::Snapshot::Empty(info);
  map::Edit edit(empty);
  map::MapCamera camera;
  camera.pinhole = Pinhole{640, 480, 500.0, 500.0, 320.0, 240.0};
  camera.model = Camera::FromPinhole(camera.pinhole);
  map::Session session;
  session.camera = edit.AddCamera(camera);
  map::Component component;
  component.session = edit.AddSession(session);
  edit.AddComponent(component);
  component.session = edit.AddSession(session);
  edit.AddComponent(component);
  edit.AddComponent(component);
  return *empty->Apply(edit.Finish("two sessions"));
}

mapping::JoinReport Join(ComponentId component, ComponentId into, ComponentId seen_in) {
  mapping::JoinReport join;
  join.joined = true;
  join.component = component;
  join.into = into;
  join.seen_in = seen_in;
  return join;
}

const ComponentId kOthers(1), kOwn(2), kOwnToo(3);

TEST(WhereaboutsNotes, TheFirstSightingInAComponentOfOthersIsKept) {
  const auto map = TwoSessions();
  WhereaboutsNotes notes(SessionId(2));
  EXPECT_FALSE(notes.Now().component);
  notes.IsIn(kOwn);
  notes.Saw(10, kOwnToo, *map);
  EXPECT_EQ(notes.Now().component, kOwn);
  EXPECT_FALSE(notes.Now().located) << "its own is nothing that was there before";
  notes.Saw(20, kOthers, *map);
  notes.Saw(30, kOthers, *map);
  ASSERT_TRUE(notes.Now().located);
  EXPECT_EQ(notes.Now().located->time_ns, 20);
  EXPECT_EQ(notes.Now().located->component, kOthers);
  EXPECT_FALSE(notes.Now().joined_ns) << "not proven yet";
}

TEST(WhereaboutsNotes, OnlyAJoinWithOthersProvesWhereItIs) {
  const auto map = TwoSessions();
  WhereaboutsNotes notes(SessionId(2));
  notes.Joined(10, Join(kOwnToo, kOwn, kOwn), kOwn, *map);
  EXPECT_FALSE(notes.Now().located);
  EXPECT_FALSE(notes.Now().joined_ns);
  notes.Joined(20, Join(kOwn, kOthers, kOthers), kOthers, *map);
  EXPECT_EQ(notes.Now().joined_ns, 20);
  ASSERT_TRUE(notes.Now().located);
  EXPECT_EQ(notes.Now().located->time_ns, 20);
  EXPECT_EQ(notes.Now().located->component, kOthers);
  EXPECT_EQ(notes.join_times_ns(), (std::vector<TimeNs>{10, 20}));
}

}  // namespace
}  // namespace cairn::engine
