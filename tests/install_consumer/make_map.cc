// What the programs that link the installed library are run on.
//
//   make_map FOLDER           writes room.cairn, photo.png, photo.pgm and frames/*.png from it, and elsewhere.pgm
//   make_map --grow FILE      makes an empty map, says "ready", and fills it after a line on standard input
#include <cmath>
#include <filesystem>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "client/conformance/conformance_map.h"
#include "store/sqlite_map_store.h"

namespace {

using cairn::conformance::ConformanceMap;
using cairn::conformance::LookInRoom;
using cairn::conformance::RenderedRoom;
using cairn::conformance::TheConformanceMap;

absl::Status WriteImage(const std::filesystem::path& path, const cv::Mat& image) {
  if (cv::imwrite(path.string(), image)) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(path.string(), ": cannot be written"));
}

absl::Status WriteAll(const std::filesystem::path& folder) {
  const ConformanceMap& map = TheConformanceMap();
  CAIRN_RETURN_IF_ERROR(cairn::conformance::WriteConformanceMap((folder / "room.cairn").string()));
  const cairn::SE3 camera = LookInRoom({0.2, 0.0, -1.4}, 0.05);
  const cv::Mat photo = map.room.Render(map.pinhole, camera);
  CAIRN_RETURN_IF_ERROR(WriteImage(folder / "photo.png", photo));
  CAIRN_RETURN_IF_ERROR(WriteImage(folder / "photo.pgm", photo));
  CAIRN_RETURN_IF_ERROR(WriteImage(folder / "elsewhere.pgm", RenderedRoom(77).Render(map.pinhole, camera)));
  std::filesystem::create_directories(folder / "frames");
  for (int i = 0; i < 30; ++i) {
    const cairn::SE3 at = LookInRoom({-0.6 + 0.03 * i, 0.02 * std::sin(0.3 * i), -1.4}, 0.1 * std::sin(0.2 * i));
    CAIRN_RETURN_IF_ERROR(
        WriteImage(folder / "frames" / absl::StrCat(1000 + i, ".png"), map.room.Render(map.pinhole, at)));
  }
  return absl::OkStatus();
}

absl::Status Grow(const std::string& path) {
  const ConformanceMap& map = TheConformanceMap();
  cairn::store::CreateOptions options;
  options.vocabulary = map.vocabulary;
  CAIRN_ASSIGN_OR_RETURN(const auto file, cairn::store::SqliteMapStore::Create(path, map.snapshot->info(), options));
  std::cout << "ready" << std::endl;
  std::string line;
  std::getline(std::cin, line);
  CAIRN_RETURN_IF_ERROR(file->Commit(map.delta));
  return file->Close();
}

}  // namespace

int main(int argc, char** argv) {
  const bool grow = argc == 3 && std::string(argv[1]) == "--grow";
  if (argc != 2 && !grow) return 2;
  const absl::Status status = grow ? Grow(argv[2]) : WriteAll(argv[1]);
  if (!status.ok()) std::cerr << "make_map: " << status << "\n";
  return status.ok() ? 0 : 1;
}
