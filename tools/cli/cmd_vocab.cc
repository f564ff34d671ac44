// cairn vocab train|import|info: the vocabulary of visual words.
#include <algorithm>
#include <filesystem>
#include <iostream>

#include "cli/cli.h"
#include "image/orb_extractor.h"
#include "io/frame_source.h"
#include "place/dbow2.h"
#include "place/default_vocabulary.h"
#include "place/training.h"
#include "place/vocabulary.h"

namespace cairn::cli {
namespace {

struct VocabOptions {
  std::vector<std::string> folders;
  std::string input;
  std::string output;
  place::TrainingOptions training;
  image::OrbParameters orb;
  bool overwrite = false;
  bool json = false;
};

nlohmann::ordered_json Describe(const place::Vocabulary& vocabulary) {
  return {{"words", vocabulary.num_words()},
          {"nodes", vocabulary.num_nodes()},
          {"branching", vocabulary.branching()},
          {"depth", vocabulary.depth()},
          {"hash", absl::StrCat(absl::Hex(vocabulary.hash(), absl::kZeroPad16))}};
}

int Report(const place::Vocabulary& vocabulary, const std::string& path, bool json) {
  const nlohmann::ordered_json description = Describe(vocabulary);
  if (json) {
    PrintJson(description);
  } else {
    std::cout << path << ": " << vocabulary.num_words() << " words in " << vocabulary.depth() << " levels of "
              << vocabulary.branching() << ", hash " << description["hash"].get<std::string>() << "\n";
  }
  return kOk;
}

absl::StatusOr<std::vector<std::string>> FindImages(const std::vector<std::string>& folders) {
  std::vector<std::string> paths;
  for (const std::string& folder : folders) {
    std::error_code error;
    for (auto it = std::filesystem::recursive_directory_iterator(folder, error);
         !error && it != std::filesystem::recursive_directory_iterator(); it.increment(error)) {
      std::string extension = it->path().extension().string();
      std::transform(extension.begin(), extension.end(), extension.begin(),
                     [](unsigned char c) { return std::tolower(c); });
      if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") paths.push_back(it->path().string());
    }
    if (error) return absl::NotFoundError(absl::StrCat("cannot read the folder ", folder, ": ", error.message()));
  }
  std::sort(paths.begin(), paths.end());
  if (paths.empty()) return absl::NotFoundError("no .png or .jpg image found below the given folders");
  return paths;
}

absl::StatusOr<place::Vocabulary> TrainFromFolders(const VocabOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.training.Validate());
  CAIRN_ASSIGN_OR_RETURN(const std::vector<std::string> paths, FindImages(options.folders));
  const image::OrbExtractor extractor(options.orb);
  std::vector<place::ImageDescriptors> images;
  Progress reading("reading images", static_cast<std::int64_t>(paths.size()), options.json);
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const auto gray = io::ReadGrayImage(paths[i]);
    if (!gray.ok()) {
      std::cerr << "cairn vocab train: left out: " << gray.status().message() << "\n";
      continue;
    }
    CAIRN_ASSIGN_OR_RETURN(image::Features features, extractor.Extract(*gray));
    images.push_back(std::move(features.descriptors));
    reading.Update(static_cast<std::int64_t>(i + 1));
  }
  reading.Finish();
  Progress training("training", 1000, options.json);
  return place::Train(images, options.training,
                      [&](double share) { training.Update(static_cast<std::int64_t>(1000 * share)); });
}

int SaveAndReport(const absl::StatusOr<place::Vocabulary>& vocabulary, const VocabOptions& options, const char* verb) {
  if (!vocabulary.ok()) return Fail(verb, vocabulary.status(), options.json);
  if (absl::Status status = vocabulary->Save(options.output); !status.ok()) return Fail(verb, status, options.json);
  return Report(*vocabulary, options.output, options.json);
}

int RunTrain(const VocabOptions& options) {
  absl::Status status = CheckWritable(options.output, options.overwrite);
  status.Update(CheckDistinct({options.output}, options.folders));
  if (!status.ok()) return Fail("vocab train", status, options.json);
  return SaveAndReport(TrainFromFolders(options), options, "vocab train");
}

int RunImport(const VocabOptions& options) {
  absl::Status status = CheckWritable(options.output, options.overwrite);
  status.Update(CheckDistinct({options.output}, {options.input}));
  if (!status.ok()) return Fail("vocab import", status, options.json);
  return SaveAndReport(place::ImportDbow2TextFile(options.input), options, "vocab import");
}

int RunVocabInfo(const VocabOptions& options) {
  std::string path = options.input;
  if (path.empty()) {
    const auto found = place::FindDefaultVocabulary();
    if (!found.ok()) return Fail("vocab info", found.status(), options.json);
    path = *found;
  }
  const auto vocabulary = place::Vocabulary::Load(path);
  if (!vocabulary.ok()) return Fail("vocab info", vocabulary.status(), options.json);
  return Report(*vocabulary, path, options.json);
}

}  // namespace

void AddVocabCommand(CLI::App& app, Action* action) {
  CLI::App* verb = app.add_subcommand("vocab", "Train, import or describe a vocabulary of visual words");
  verb->require_subcommand(1);
  auto options = std::make_shared<VocabOptions>();

  CLI::App* train = verb->add_subcommand("train", "Train a vocabulary from the images below some folders");
  train->add_option("FOLDER", options->folders, "Folders of .png and .jpg images")->required();
  train->add_option("--out", options->output, "The vocabulary file to write")->required();
  train->add_option("--branching", options->training.branching, "Children per node")->capture_default_str();
  train->add_option("--depth", options->training.depth, "Levels")->capture_default_str();
  train->add_option("--seed", options->training.seed, "Seed of the clustering")->capture_default_str();
  train->add_option("--features", options->orb.num_features, "Features per image")->capture_default_str();
  train->add_flag("--overwrite", options->overwrite, "Replace the file if it exists");
  train->add_flag("--json", options->json, "Answer in JSON");
  train->footer("Example:\n  cairn vocab train ~/photos --out photos.cairnvoc");
  train->callback([=] { *action = [=] { return RunTrain(*options); }; });

  CLI::App* import = verb->add_subcommand("import", "Import a vocabulary from DBoW2's text form");
  import->add_option("FILE", options->input, "DBoW2 text file")->required();
  import->add_option("--out", options->output, "The vocabulary file to write")->required();
  import->add_flag("--overwrite", options->overwrite, "Replace the file if it exists");
  import->add_flag("--json", options->json, "Answer in JSON");
  import->footer("Example:\n  cairn vocab import ORBvoc.txt --out orb.cairnvoc");
  import->callback([=] { *action = [=] { return RunImport(*options);
};
}  // namespace cairn::cli
);

CLI::App* info = verb->add_subcommand("info", "Describe a vocabulary (the one that comes with Cairn if none is named)");
info->add_option("FILE", options->input, "Vocabulary file");
info->add_flag("--json", options->json, "Answer in JSON");
info->footer("Example:\n  cairn vocab info");
info->callback([=] { *action = [=] { return RunVocabInfo(*options); }; });
}

}  // namespace cairn::cli
