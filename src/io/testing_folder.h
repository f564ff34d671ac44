// For tests: a temporary folder, removed at the end, and small data sets in it.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace cairn::io {

class TestingFolder {
 public:
  TestingFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "cairn_test_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) ADD_FAILURE() << "no temporary folder";
    path_ = name;
  }
  ~TestingFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TestingFolder(const TestingFolder&) = delete;
  TestingFolder& operator=(const TestingFolder&) = delete;

  std::string str() const { return path_.string(); }
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }

  void Write(const std::string& name, absl::string_view text) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << text;
  }
  std::string Read(const std::string& name) const {
    std::ifstream in(path_ / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  }
  void WriteImage(const std::string& name, const cv::Mat& image) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    ASSERT_TRUE(cv::imwrite((path_ / name).string(), image));
  }
  // A gray ramp of 32x24 px that starts with `seed` at the top left.
  void WriteImage(const std::string& name, int seed) const { WriteImage(name, Ramp(seed)); }

  static cv::Mat Ramp(int seed) {
    cv::Mat image(24, 32, CV_8UC1);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x)
        image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(seed + 3 * x + 2 * y);
    }
    return image;
  }

  // Cuts a file to a part of its length.
  void Truncate(const std::string& name, double part) const {
    const auto size = static_cast<double>(std::filesystem::file_size(path_ / name));
    std::filesystem::resize_file(path_ / name, static_cast<std::uintmax_t>(size * part));
  }

 private:
  std::filesystem::path path_;
};

}  // namespace cairn::io
