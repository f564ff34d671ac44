#include "store/migrations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "store/fault.h"
#include "store/map_open.h"

namespace cairn::store {
namespace {

using ::testing::HasSubstr;

const std::vector<Migration> kThree = {
    {1, "0001_a.sql", "CREATE TABLE a (id INTEGER PRIMARY KEY, v)"},
    {2, "0002_b.sql", "ALTER TABLE a ADD COLUMN w NOT NULL DEFAULT 7; CREATE TABLE b (a REFERENCES a (id))"},
    {3, "0003_c.sql", "UPDATE a SET w = w + v"},
};

std::unique_ptr<Database> Memory() { return *Database::OpenFile("", Database::Mode::kMemory); }

TEST(Migrations, BuiltInOnesAreNumberedWithoutGaps) {
  int expected = 1;
  for (const Migration& migration : BuiltInMigrations()) EXPECT_EQ(migration.version, expected++);
  EXPECT_GE(expected, 2);
}

// After a new migration: kNewestObjects in map_open.cc is ChecksumOf() what it makes.
TEST(Migrations, WhatTheyMakeIsKnownAtOnce) {
  const auto database = Memory();
  ASSERT_TRUE(Migrate(database.get(), BuiltInMigrations()).ok());
  EXPECT_TRUE(*HasNewestObjects(database.get()));
  ASSERT_TRUE(database->Execute("CREATE TABLE further (id)").ok());
  EXPECT_FALSE(*HasNewestObjects(database.get()));
}

TEST(Migrations, ApplyOnceAndInOrder) {
  const auto database = Memory();
  ASSERT_TRUE(Migrate(database.get(), std::span(kThree).first(1)).ok());
  EXPECT_EQ(*database->QueryInt("PRAGMA user_version"), 1);
  EXPECT_EQ(*database->QueryInt("PRAGMA application_id"), kApplicationId);
  ASSERT_TRUE(database->Execute("INSERT INTO a VALUES (1, 10)").ok());
  ASSERT_TRUE(Migrate(database.get(), kThree).ok());
  EXPECT_EQ(*database->QueryInt("SELECT w FROM a"), 17);
  ASSERT_TRUE(Migrate(database.get(), kThree).ok());
  EXPECT_EQ(*database->QueryInt("SELECT w FROM a"), 17);
  EXPECT_EQ(*database->QueryInt("PRAGMA user_version"), 3);
  EXPECT_EQ(*database->QueryInt("PRAGMA foreign_keys"), 1);
}

TEST(Migrations, AFailureChangesNothing) {
  const auto database = Memory();
  ASSERT_TRUE(Migrate(database.get(), std::span(kThree).first(1)).ok());
  std::vector<Migration> broken(kThree);
  broken[2].sql = "UPDATE nowhere SET w = 1";
  const absl::Status status = Migrate(database.get(), broken);
  EXPECT_THAT(std::string(status.message()), HasSubstr("0003_c.sql"));
  EXPECT_EQ(*database->QueryInt("PRAGMA user_version"), 1);
  EXPECT_FALSE(database->QueryInt("SELECT w FROM a").ok());
}

TEST(Migrations, DanglingReferencesAreRefused) {
  const auto database = Memory();
  std::vector<Migration> broken(kThree);
  broken[2].sql = "INSERT INTO b VALUES (99)";
  EXPECT_EQ(FaultOf(Migrate(database.get(), broken)), Fault::kDamaged);
  EXPECT_EQ(*database->QueryInt("PRAGMA user_version"), 0);
}

TEST(Migrations, NewerDatabasesAreRefused) {
  const auto database = Memory();
  ASSERT_TRUE(Migrate(database.get(), kThree).ok());
  const absl::Status status = Migrate(database.get(), std::span(kThree).first(2));
  EXPECT_TRUE(IsNewerVersion(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("format 3"));
}

}  // namespace
}  // namespace cairn::store
