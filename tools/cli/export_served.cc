#include "cli/export_served.h"

#include <filesystem>
#include <fstream>
#include <memory>

#include "cli/server_option.h"

namespace cairn::cli {
namespace {

absl::Status Fetch(const ServerChoice& server, const std::string& map, api::ExportContent content,
                   const std::string& path) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<client::RemoteMapService> service, ConnectTo(server));
  const auto failed = [&] { return absl::ResourceExhaustedError(absl::StrCat(path, " cannot be written")); };
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  CAIRN_RETURN_IF_ERROR(service->Export(map, content, [&](absl::string_view part) {
    file.write(part.data(), static_cast<std::streamsize>(part.size()));
    return file ? absl::OkStatus() : failed();
  }));
  file.close();
  return file ? absl::OkStatus() : failed();
}

}  // namespace

std::optional<api::ExportContent> ContentOfFile(const std::string& path) {
  const std::string end = std::filesystem::path(path).extension().string();
  if (end == ".cairn") return api::ExportContent::kMap;
  if (end == ".txt" || end == ".tum") return api::ExportContent::kTrajectory;
  if (end == ".ply") return api::ExportContent::kPoints;
  return std::nullopt;
}

absl::Status ExportServed(const ServerChoice& server, const std::string& map, api::ExportContent content,
                          const std::string& path) {
  const std::string part = path + ".part";
  std::error_code error;
  absl::Status status = Fetch(server, map, content, part);
  if (status.ok()) {
    std::filesystem::rename(part, path, error);
    if (error) status = absl::InternalError(absl::StrCat(path, ": ", error.message()));
  }
  if (!status.ok()) std::filesystem::remove(part, error);
  return status;
}

}  // namespace cairn::cli
