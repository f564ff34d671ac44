// cairn --server HOST:PORT: verbs that ask a cairnd instead of a file.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "base/status.h"
#include "cli/interrupt.h"
#include "client/remote/remote_map_service.h"

namespace cairn::cli {

// Which server, and what it is to be shown and to show.
struct ServerChoice {
  std::string address;     // empty: no server was named, MAP is a file
  std::string token_file;  // empty: the environment's CAIRN_TOKEN, if it is set
  client::ClientTlsFiles tls;
  bool token_in_clear = false;
  bool send_features = false;                 // of images to be located, in place of their pixels
  const InterruptWatch* interrupt = nullptr;  // a signal ends the wait for a server that is away

  bool empty() const { return address.empty(); }
};

// Whether the verb knows what to do with --server.
bool AsksServers(absl::string_view verb);

void AddServerOption(CLI::App& app);
ServerChoice ServerOf(const CLI::App& app);

// "--send image|features" of a verb that locates images.
void AddSendOption(CLI::App* verb, std::string* send);

// Reads the files that it names.
absl::StatusOr<client::RemoteOptions> RemoteOptionsOf(const ServerChoice& server);
absl::StatusOr<std::unique_ptr<client::RemoteMapService>> ConnectTo(const ServerChoice& server);

// The maps of a server, or, without one, those of the directory that holds the file `path` (`name` then is the file's):
// for verbs that say the same of both.
struct NamedMap {
  std::unique_ptr<api::MapService> service;
  std::string name;
};
// InvalidArgument for a file that is not called as a map of a directory is: NAME.cairn.
absl::StatusOr<NamedMap> FindMap(const ServerChoice& server, const std::string& path);

}  // namespace cairn::cli
