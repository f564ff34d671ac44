#include "cli/server_option.h"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <iostream>
#include <utility>

#include "absl/strings/ascii.h"
#include "base/files.h"
#include "client/remote/server_access.h"
#include "host/map_host.h"

namespace cairn::cli {
namespace {

constexpr const char *kServer = "--server", *kTokenFile = "--token-file", *kTls = "--tls", *kCa = "--ca",
                     *kCertificate = "--cert", *kKey = "--key", *kTokenInClear = "--token-in-clear";
constexpr std::uint64_t kMaxTokenBytes = 4096;
// The verbs that ask a server as they ask a file; the others are about files.
constexpr std::array<absl::string_view, 22> kServedVerbs = {
    "ls",  "info",  "show",   "stats",    "explain", "coverage", "diff",   "render",  "log", "localize", "track",
    "run", "align", "verify", "snapshot", "export",  "create",   "delete", "restore", "top", "bench",    "session"};

std::string TextOf(const CLI::App& app, const char* name) {
  const CLI::Option* option = app.get_option(name);
  return option->count() > 0 ? option->as<std::string>() : "";
}

absl::StatusOr<std::string> TokenOf(const ServerChoice& server) {
  if (server.token_file.empty()) return std::string();
  CAIRN_ASSIGN_OR_RETURN(const std::string token, ReadWholeFile(server.token_file, kMaxTokenBytes));
  struct stat file = {};
  if (stat(server.token_file.c_str(), &file) == 0 && (file.st_mode & (S_IRGRP | S_IROTH)) != 0) {
    std::cerr << "warning: others on this machine can read the token in " << server.token_file << ": chmod 600 it\n";
  }
  return std::string(absl::StripAsciiWhitespace(token));
}

}  // namespace

bool AsksServers(absl::string_view verb) { return std::ranges::find(kServedVerbs, verb) != kServedVerbs.end(); }

void AddServerOption(CLI::App& app) {
  constexpr const char* kGroup = "A server";
  // By reference: that is what CLI11 takes a help text as.
  const auto add = [&](const char* name, const std::string& help) { return app.add_option(name, help)->group(kGroup); };
  const auto flag = [&](const char* name, const std::string& help) { return app.add_flag(name, help)->group(kGroup); };
  CLI::Option* const server =
      add(kServer,
          "HOST[:PORT] of a cairnd (7878): ls, info, show, stats, explain, coverage, diff, render, "
          "log, localize, track, run, align, verify, snapshot, export, create, delete, restore, session, top "
          "and bench server ask it, and MAP is a name there")
          ->check([](const std::string& named) {
            return named.empty() ? "names no server (is a variable not set?); without --server MAP is a file" : "";
          });
  add(kTokenFile, "File with the token that it asks for (cairnd token create); else CAIRN_TOKEN of the environment")
      ->needs(server);
  flag(kTls, "It speaks TLS, with a certificate of a CA that this machine trusts")->needs(server);
  add(kCa, "It speaks TLS, with a certificate of the CA of this PEM file")->needs(server);
  CLI::Option* const certificate = add(kCertificate, "PEM file: the certificate that it asks for");
  certificate->needs(server)->needs(add(kKey, "PEM file: the key of that certificate")->needs(certificate));
  flag(kTokenInClear, "Send the token without TLS, also to other machines: whoever listens on the way has it then")
      ->needs(server);
}

ServerChoice ServerOf(const CLI::App& app) {
  ServerChoice server;
  server.address = TextOf(app, kServer);
  server.token_file = TextOf(app, kTokenFile);
  server.tls.ca = TextOf(app, kCa);
  server.tls.certificate = TextOf(app, kCertificate);
  server.tls.key = TextOf(app, kKey);
  server.tls.on = app.get_option(kTls)->count() > 0;
  server.token_in_clear = app.get_option(kTokenInClear)->count() > 0;
  return server;
}

void AddSendOption(CLI::App* verb, std::string* send) {
  verb->add_option("--send", *send,
                   "With --server: the image, or its features, which are extracted here: no pixels leave this machine")
      ->check(CLI::IsMember({"image", "features"}))
      ->default_str("image");
}

absl::StatusOr<client::RemoteOptions> RemoteOptionsOf(const ServerChoice& server) {
  client::ServerAccess access{"", server.tls, server.token_in_clear};
  CAIRN_ASSIGN_OR_RETURN(access.token, TokenOf(server));
  CAIRN_ASSIGN_OR_RETURN(client::RemoteOptions options, client::RemoteOptionsFor(server.address, std::move(access)));
  options.send_features = server.send_features;
  if (!server.token_file.empty()) options.read_token = [server] { return TokenOf(server); };
  options.on_outage = [outage_s = options.outage_s](const absl::Status& status) {
    std::cerr << "waiting for the server, up to " << outage_s << " s: " << std::string(status.message()) << "\n";
  };
  if (server.interrupt != nullptr) options.give_up = [watch = server.interrupt] { return watch->signalled(); };
  return options;
}

absl::StatusOr<std::unique_ptr<client::RemoteMapService>> ConnectTo(const ServerChoice& server) {
  CAIRN_ASSIGN_OR_RETURN(const client::RemoteOptions options, RemoteOptionsOf(server));
  return client::RemoteMapService::Connect(options);
}

absl::StatusOr<NamedMap> FindMap(const ServerChoice& server, const std::string& path) {
  NamedMap found;
  if (!server.empty()) {
    CAIRN_ASSIGN_OR_RETURN(found.service, ConnectTo(server));
    found.name = path;
    return found;
  }
  const std::filesystem::path file(path);
  if (file.extension() != ".cairn") {
    return absl::InvalidArgumentError(absl::StrCat(path, ": the file of a map is called NAME.cairn"));
  }
  host::MapHostOptions options;
  options.directory = file.has_parent_path() ? file.parent_path().string() : ".";
  CAIRN_ASSIGN_OR_RETURN(found.service, host::MapHost::Open(options));
  found.name = file.stem().string();
  return found;
}

}  // namespace cairn::cli
