// Place recognition and matching with the default vocabulary on real sequences, named by the environment variable
// CAIRN_DATA_DIR (skipped without it).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "image/orb_extractor.h"
#include "place/default_vocabulary.h"
#include "place/index.h"

namespace cairn::place {
namespace {

namespace fs = std::filesystem;

// The vocabulary in $CAIRN_TEST_VOCABULARY, to compare another one, or the default.
absl::StatusOr<Vocabulary> TestVocabulary() {
  if (const char* path = std::getenv("CAIRN_TEST_VOCABULARY")) return Vocabulary::Load(path);
  return LoadDefaultVocabulary();
}

class PlaceRecognition : public testing::Test {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("CAIRN_DATA_DIR");
    if (!folder || !fs::is_directory(folder))
      GTEST_SKIP() << "CAIRN_DATA_DIR does not name the folder of test sequences";
    data_ = folder;
    vocabulary_ = TestVocabulary();
    ASSERT_TRUE(vocabulary_.ok()) << vocabulary_.status();
    cv::setNumThreads(1);
  }

  struct View {
    image::Features features;
    BagOfWords bag;
  };
  View MakeView(const fs::path& path, int level = Vocabulary::kDefaultDirectLevel) const {
    View view;
    absl::StatusOr<image::Features> features =
        image::OrbExtractor({}).Extract(cv::imread(path.string(), cv::IMREAD_GRAYSCALE), 1500);
    EXPECT_TRUE(features.ok()) << path << ": " << features.status();
    if (features.ok()) view.features = *std::move(features);
    view.bag = vocabulary_->Transform(view.features, level);
    return view;
  }

  std::vector<float> Weights() const {
    std::vector<float> weights(vocabulary_->num_words());
    for (WordId word = 0; word < weights.size(); ++word) weights[word] = vocabulary_->weight(word);
    return weights;
  }

  fs::path data_;
  absl::StatusOr<Vocabulary> vocabulary_ = absl::UnknownError("not loaded");
};

std::vector<fs::path> ImagesIn(const fs::path& folder) {
  std::vector<fs::path> paths;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  return paths;
}

TEST_F(PlaceRecognition, FindsTheOtherCameraOfAStereoPair) {
  const fs::path sequence = data_ / "euroc_v101_keyframes" / "mav0";
  if (!fs::is_directory(sequence)) GTEST_SKIP() << sequence << " is not there";
  const std::vector<fs::path> left = ImagesIn(sequence / "cam0" / "data"), right = ImagesIn(sequence / "cam1" / "data");
  ASSERT_EQ(left.size(), right.size());
  InvertedIndex index(Weights());
  std::vector<View> views;
  for (std::uint32_t i = 0; i < left.size(); ++i) {
    views.push_back(MakeView(left[i]));
    ASSERT_TRUE(index.Add(i, views.back().bag.words).ok());
  }
  int first = 0, among_three = 0;
  double guided = 0.0, brute = 0.0;
  for (std::uint32_t i = 0; i < right.size(); ++i) {
    const View query = MakeView(right[i]);
    QueryOptions options;
    options.max_results = 3;
    const std::vector<Candidate> candidates = index.Query(query.bag.words, options);
    first += !candidates.empty() && candidates[0].id == i;
    among_three += std::any_of(candidates.begin(), candidates.end(), [i](const Candidate& c) { return c.id == i; });
    guided += static_cast<double>(
        MatchByWords(query.features, query.bag.direct, views[i].features, views[i].bag.direct).size());
    brute += static_cast<double>(image::MatchBruteForce(query.features, views[i].features).size());
  }
  const double count = static_cast<double>(right.size());
  std::printf("stereo partner first %d, among the first three %d of %zu; matches by words %.0f, by brute force %.0f\n",
              first, among_three, right.size(), guided / count, brute / count);
  EXPECT_GE(among_three, 0.9 * count);
  EXPECT_GE(guided, 0.5 * brute);
}

// Camera in world: position and quaternion x y z w, by time in seconds.
std::map<double, std::array<double, 7>> ReadPoses(const fs::path& path) {
  std::map<double, std::array<double, 7>> poses;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream row(line);
    double time = 0.0;
    std::array<double, 7> pose{};
    row >> time;
    for (double& value : pose) row >> value;
    if (row) poses[time] = pose;
  }
  return poses;
}

bool Near(const std::array<double, 7>& a, const std::array<double, 7>& b, double max_m, double max_deg) {
  double dot = 0.0;
  for (int i = 3; i < 7; ++i) dot += a[i] * b[i];
  const double angle_deg = 2.0 * std::acos(std::min(1.0, std::abs(dot))) * 180.0 / 3.14159265358979;
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) <= max_m && angle_deg <= max_deg;
}

TEST_F(PlaceRecognition, FindsOverlappingViewsOfAnEarlierSession) {
  const fs::path sequence = data_ / "redkitchen";
  if (!fs::is_directory(sequence)) GTEST_SKIP() << sequence << " is not there";
  const auto poses = ReadPoses(sequence / "reference_sfm.txt");
  const auto image = [&](double time) {
    char name[32];
    std::snprintf(name, sizeof(name), "%.6f.jpg", time);
    return sequence / "rgb" / name;
  };
  InvertedIndex index(Weights());
  std::vector<std::array<double, 7>> map;
  std::size_t row = 0;
  for (const auto& [time, pose] : poses) {
    if (time >= 20.0 || row++ % 4 != 0) continue;
    ASSERT_TRUE(index.Add(static_cast<std::uint32_t>(map.size()), MakeView(image(time)).bag.words).ok());
    map.push_back(pose);
  }
  int queries = 0;
  std::array<int, 2> found{};  // among the first, the first five
  for (const auto& [time, pose] : poses) {
    if (time < 20.0) continue;
    const auto is_near = [&](const std::array<double, 7>& other) { return Near(pose, other, 0.5, 30.0); };
    if (std::none_of(map.begin(), map.end(), is_near)) continue;
    if (++queries % 2 == 0) continue;
    QueryOptions options;
    options.max_results = 5;
    const std::vector<Candidate> candidates = index.Query(MakeView(image(time)).bag.words, options);
    found[0] += !candidates.empty() && is_near(map[candidates[0].id]);
    found[1] +=
        std::any_of(candidates.begin(), candidates.end(), [&](const Candidate& c) { return is_near(map[c.id]); });
  }
  queries = (queries + 1) / 2;
  std::printf("a view within 0.5 m and 30 deg: first %d, among the first five %d of %d (map of %zu)\n", found[0],
              found[1], queries, map.size());
  ASSERT_GT(queries, 20);
  EXPECT_GE(found[1], 0.9 * queries);
}

}  // namespace
}  // namespace cairn::place
