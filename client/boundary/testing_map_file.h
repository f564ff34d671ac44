// What the tests of the boundary share.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "cairn/camera.h"
#include "geometry/pinhole.h"

namespace cairn::conformance {

// A name for a map file, which is removed before and after.
struct TestingMapFile {
  explicit TestingMapFile(const std::string& name)
      : path(testing::TempDir() + "/" + name + "_" + std::to_string(getpid()) + ".cairn") {
    Remove();
  }
  ~TestingMapFile() { Remove(); }
  TestingMapFile(const TestingMapFile&) = delete;
  TestingMapFile& operator=(const TestingMapFile&) = delete;

  const std::string path;

 private:
  void Remove() const {
    std::error_code ignored;
    for (const char* end : {"", "-wal", "-shm", "-lock"}) std::filesystem::remove(path + end, ignored);
  }
};

inline v0::Camera ToPublicCamera(const Pinhole& pinhole) {
  v0::Camera camera;
  camera.width_px = pinhole.width_px;
  camera.height_px = pinhole.height_px;
  camera.fx_px = pinhole.fx_px;
  camera.fy_px = pinhole.fy_px;
  camera.cx_px = pinhole.cx_px;
  camera.cy_px = pinhole.cy_px;
  return camera;
}

}  // namespace cairn::conformance
