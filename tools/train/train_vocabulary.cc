// Trains a vocabulary from views put together from photographs, textures and cut-out objects. Run by
// tools/train_default_vocabulary; the same input gives the same file.
#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "base/random.h"
#include "image/orb_extractor.h"
#include "place/training.h"
#include "scenes.h"

namespace {

struct Arguments {
  std::string photographs, textures, objects, output, samples;
  int views = 2000;
  int features = 1500;
  cairn::place::TrainingOptions training;
};

absl::Status Run(const Arguments& arguments) {
  cv::setNumThreads(1);
  cairn::train::Library library;
  CAIRN_ASSIGN_OR_RETURN(library.photographs, cairn::train::LoadPictures(arguments.photographs, 2560, 400));
  CAIRN_ASSIGN_OR_RETURN(library.textures, cairn::train::LoadPictures(arguments.textures, 640, 1500));
  CAIRN_ASSIGN_OR_RETURN(library.objects, cairn::train::LoadPictures(arguments.objects, 512, 1000));
  std::printf("%zu photographs, %zu textures, %zu objects\n", library.photographs.size(), library.textures.size(),
              library.objects.size());

  const cairn::image::OrbExtractor extractor{cairn::image::OrbParameters{}};
  cairn::Random random(arguments.training.seed);
  std::vector<cairn::place::ImageDescriptors> images;
  std::size_t total = 0;
  for (int i = 0; i < arguments.views; ++i) {
    const cv::Mat view = cairn::train::MakeView(library, &random);
    if (!arguments.samples.empty() && i < 20) cv::imwrite(absl::StrCat(arguments.samples, "/", i, ".png"), view);
    CAIRN_ASSIGN_OR_RETURN(cairn::image::Features features, extractor.Extract(view, arguments.features));
    total += features.size();
    images.push_back(std::move(features.descriptors));
    if ((i + 1) % 250 == 0) std::printf("%d of %d views, %zu descriptors\n", i + 1, arguments.views, total);
    std::fflush(stdout);
  }

  int percent = 0;
  const auto progress = [&](double done) {
    if (static_cast<int>(100 * done) < percent + 5) return;
    percent = static_cast<int>(100 * done);
    std::printf("training %d %%\n", percent);
    std::fflush(stdout);
  };
  CAIRN_ASSIGN_OR_RETURN(const cairn::place::Vocabulary vocabulary,
                         cairn::place::Train(images, arguments.training, progress));
  CAIRN_RETURN_IF_ERROR(vocabulary.Save(arguments.output));
  std::printf("%s: %zu words, %zu nodes, hash %016llx\n", arguments.output.c_str(), vocabulary.num_words(),
              vocabulary.num_nodes(), static_cast<unsigned long long>(vocabulary.hash()));
  return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Trains a vocabulary from views put together from photographs, textures and cut-out objects");
  Arguments arguments;
  app.add_option("--photographs", arguments.photographs, "folder of photographs")->required();
  app.add_option("--textures", arguments.textures, "folder of surface textures")->required();
  app.add_option("--objects", arguments.objects, "folder of cut-out objects (png with opacity)")->required();
  app.add_option("--output", arguments.output, "vocabulary file to write")->required();
  app.add_option("--samples", arguments.samples, "folder that receives the first 20 views");
  app.add_option("--views", arguments.views, "number of views")->check(CLI::Range(2, 100000))->capture_default_str();
  app.add_option("--features", arguments.features, "ORB features per view")->capture_default_str();
  app.add_option("--branching", arguments.training.branching, "children per node")->capture_default_str();
  app.add_option("--depth", arguments.training.depth, "levels of the tree")->capture_default_str();
  app.add_option("--seed", arguments.training.seed, "seed of all random choices")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  if (const absl::Status status = Run(arguments); !status.ok()) {
    std::fprintf(stderr, "train_vocabulary: %s\n", std::string(status.message()).c_str());
    return 1;
  }
  return 0;
}
