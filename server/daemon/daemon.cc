#include "server/daemon/daemon.h"

#include <fcntl.h>
#include <malloc.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "wire/addresses.h"

namespace cairn::server {
namespace {

// With the port that was given out.
std::string Bound(const std::string& address, int port) {
  if (absl::StartsWith(address, "unix:")) return address;
  return absl::StrCat(address.substr(0, address.rfind(':')), ":", port);
}

absl::Status CheckProtected(const DaemonOptions& options, const std::string& address) {
  if (wire::IsLoopback(address) || (options.tls.on() && !options.access.tokens.empty())) return absl::OkStatus();
  const absl::string_view missing = options.tls.on() ? "tokens (tokens) are"
                                    : !options.access.tokens.empty()
                                        ? "TLS (tls_certificate, tls_key) is"
                                        : "TLS (tls_certificate, tls_key) and tokens (tokens) are";
  return absl::FailedPreconditionError(absl::StrCat(
      "other machines reach ", address, ", and ", missing,
      " missing: docs/server.md, \"Security\", says how to set them up in ten minutes. Or listen on 127.0.0.1, or say "
      "--without-protection if everyone who gets there may read, or do, everything"));
}

// A log is no file that something else is read from or written to.
absl::Status CheckOwnFiles(const DaemonOptions& options) {
  const std::vector<std::pair<const char*, std::string>> files = {{"audit_log", options.access.audit_log},
                                                                  {"request_log", options.access.request_log},
                                                                  {"tokens", options.access.tokens},
                                                                  {"tls_certificate", options.tls.certificate},
                                                                  {"tls_key", options.tls.key},
                                                                  {"tls_client_ca", options.tls.client_ca}};
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t j = i + 1; j < files.size() && !files[i].second.empty(); ++j) {
      std::error_code error;
      const auto whole = [&](const std::string& path) { return std::filesystem::weakly_canonical(path, error); };
      if (files[j].second.empty() || whole(files[i].second) != whole(files[j].second)) continue;
      return absl::InvalidArgumentError(absl::StrCat(files[i].first, ", ", files[j].first, ": both are ",
                                                     files[i].second, ", and a log needs a file of its own"));
    }
  }
  return absl::OkStatus();
}

std::int64_t NowUnixS() { return absl::ToUnixSeconds(absl::Now()); }

absl::StatusOr<std::optional<ServerTls>> TlsOf(const TlsOptions& options) {
  std::optional<ServerTls> tls;
  if (!options.on()) return tls;
  CAIRN_ASSIGN_OR_RETURN(tls, LoadServerTls(options, NowUnixS()));
  constexpr std::int64_t kSoonS = 14 * 24 * 3600;
  if (tls->expires_unix_s < NowUnixS() + kSoonS) {
    spdlog::warn("the certificate of {} expires in less than two weeks", options.certificate);
  }
  return tls;
}

// A log that is there, or the folder that it would be in.
absl::Status CheckLog(const std::string& path) {
  if (path.empty()) return absl::OkStatus();
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    return absl::FailedPreconditionError(absl::StrCat("the log ", path, " is a folder: name a file"));
  }
  CAIRN_RETURN_IF_ERROR(CheckIsLog(path));
  const bool there = std::filesystem::exists(path, error);
  const std::string folder = std::filesystem::absolute(path, error).parent_path().string();
  if (::access(there ? path.c_str() : folder.c_str(), W_OK) == 0) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat("the log ", path, " cannot be written: ", std::strerror(errno)));
}

void RecordAbandoned(const host::SessionTable::Abandoned& session, Access* access) {
  const api::SessionProgress& progress = session.session.progress;
  const Client client = access->LetGo(session.session.map, progress.session).value_or(Client{.peer = "server"});
  const std::string details = absl::StrFormat(R"({"session":%d,"frames":%d,"revision":%d})", progress.session.value(),
                                              session.session.frames, progress.revision);
  access->Record(client, {"session_abandoned", session.session.map, details}, session.finished);
}

// gRPC takes a Unix socket over, also from a server that is at it.
absl::Status CheckSocketIsFree(const std::string& address) {
  if (!absl::StartsWith(address, "unix:")) return absl::OkStatus();
  sockaddr_un name{};
  name.sun_family = AF_UNIX;
  const std::string path = address.substr(5);
  if (path.size() >= sizeof(name.sun_path)) {
    return absl::InvalidArgumentError(
        absl::StrCat(address, ": the path of a socket has less than ", sizeof(name.sun_path), " characters"));
  }
  std::memcpy(name.sun_path, path.data(), path.size());
  const int socket = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return absl::UnavailableError(absl::StrCat(address, ": ", std::strerror(errno)));
  const bool answered = connect(socket, reinterpret_cast<const sockaddr*>(&name), sizeof(name)) == 0;
  close(socket);
  if (!answered) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("listening on ", address, ": another server is at it"));
}

// A server that was just killed holds its ports until the system has taken it apart.
template <class Start>
auto OncePortIsFree(const Start& start) {
  constexpr std::chrono::milliseconds kPatience(1000), kPause(50);
  const auto until = std::chrono::steady_clock::now() + kPatience;
  auto started = start();
  while (absl::IsUnavailable(started.status()) && std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(kPause);
    started = start();
  }
  return started;
}

ServerState StateOf(host::MapHost& maps, const Access& access) {
  ServerState state;
  state.lost_audit_lines = access.lost_audit_lines();
  for (const host::MapHost::OpenMap& map : maps.OpenMaps()) {
    state.open_maps.push_back({map.name, map.revision, map.bytes, map.writing, map.log_bytes});
  }
  state.free_bytes = maps.FreeBytes();
  state.active_sessions = maps.ActiveSessions();
  state.waiting = maps.waiting();
  state.followers = maps.followers();
  const host::SessionTable::Counts sessions = maps.sessions();
  state.sessions = sessions.held;
  state.sessions_waiting = sessions.waiting;
  return state;
}

}  // namespace

absl::Status DaemonOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(maps.Validate());
  CAIRN_RETURN_IF_ERROR(wire::CheckAddress(grpc.address));
  if (grpc.max_message_bytes < 1 << 16 || grpc.max_message_bytes > 1 << 30) {
    return absl::InvalidArgumentError("grpc: max_message_bytes must be 64 KB to 1 GB");
  }
  if (grpc.max_threads < 8) return absl::InvalidArgumentError("grpc: max_threads must be at least 8");
  if (http.max_connections < 1) return absl::InvalidArgumentError("http: max_connections must be positive");
  if (!geopose_map.empty()) CAIRN_RETURN_IF_ERROR(Annotate(api::CheckMapName(geopose_map), "geopose_map"));
  if (images.max_pixels < 1) return absl::InvalidArgumentError("images: max_pixels must be positive");
  if (!no_http) CAIRN_RETURN_IF_ERROR(wire::CheckAddress(http.address));
  if (!no_http && grpc.address == http.address && !absl::EndsWith(grpc.address, ":0")) {
    return absl::InvalidArgumentError(
        absl::StrCat("listen, listen_http: both are ", grpc.address, ", and each needs an address of its own"));
  }
  CAIRN_RETURN_IF_ERROR(tls.Validate());
  CAIRN_RETURN_IF_ERROR(access.Validate());
  CAIRN_RETURN_IF_ERROR(cors.Validate());
  CAIRN_RETURN_IF_ERROR(CheckOwnFiles(*this));
  if (without_protection) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(CheckProtected(*this, grpc.address));
  return no_http ? absl::OkStatus() : CheckProtected(*this, http.address);
}

// Whether this machine has such an address; not whether its port is free, as the server that is checked may be running.
absl::Status CheckListening(const std::string& address) {
  if (absl::StartsWith(address, "unix:")) {
    const std::filesystem::path socket(address.substr(5));
    const std::string folder = std::filesystem::absolute(socket).parent_path().string();
    if (::access(folder.c_str(), W_OK | X_OK) == 0) return absl::OkStatus();
    return absl::FailedPreconditionError(
        absl::StrCat(address, ": no socket can be made in ", folder, ": ", std::strerror(errno)));
  }
  HttpServerOptions tried;
  tried.address = absl::StrCat(address.substr(0, address.rfind(':')), ":0");
  return HttpServer::Start(tried, [](const HttpRequest&) { return HttpResponse(); }).status();
}

absl::Status DaemonOptions::CheckFiles() const {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<host::MapHost> host, host::MapHost::Open(maps));
  CAIRN_RETURN_IF_ERROR(host->Ready());
  for (const std::string& log : {access.audit_log, access.request_log}) CAIRN_RETURN_IF_ERROR(CheckLog(log));
  CAIRN_RETURN_IF_ERROR(TlsOf(tls).status());
  CAIRN_RETURN_IF_ERROR(CheckListening(grpc.address));
  if (!no_http) CAIRN_RETURN_IF_ERROR(CheckListening(http.address));
  if (!geopose_map.empty() && !std::filesystem::exists(maps.directory + "/" + geopose_map + ".cairn")) {
    return absl::NotFoundError(absl::StrCat("geopose_map: there is no map \"", geopose_map, "\" in ", maps.directory));
  }
  return access.tokens.empty() ? absl::OkStatus() : ReadTokens(access.tokens).status();
}

std::vector<std::string> DaemonOptions::Warnings() const {
  std::vector<std::string> warnings;
  if (::faccessat(AT_FDCWD, maps.directory.c_str(), W_OK | X_OK, AT_EACCESS) != 0) {
    warnings.push_back(absl::StrCat("maps cannot be made, extended or deleted in ", maps.directory, " (",
                                    std::strerror(errno), "): those that are there are served"));
  }
  return warnings;
}

std::string DaemonOptions::ProtectionText() const {
  const bool local = wire::IsLoopback(grpc.address) && (no_http || wire::IsLoopback(http.address));
  const absl::string_view encrypted = !tls.on()               ? "not encrypted"
                                      : tls.client_ca.empty() ? "TLS"
                                                              : "TLS with certificates of clients";
  return absl::StrCat(local ? "only this machine reaches it" : "other machines reach it", "; ", encrypted,
                      access.tokens.empty() ? ", whoever asks may do everything" : ", who asks needs a token",
                      local && (!tls.on() || access.tokens.empty()) ? "; docs/server.md says how to go beyond" : "");
}

absl::StatusOr<std::unique_ptr<Daemon>> Daemon::Start(const DaemonOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  auto daemon = std::unique_ptr<Daemon>(new Daemon);
  CAIRN_ASSIGN_OR_RETURN(daemon->access_, Access::Open(options.access));
  host::MapHostOptions maps = options.maps;
  maps.on_abandoned = [access = daemon->access_.get()](const host::SessionTable::Abandoned& session) {
    RecordAbandoned(session, access);
  };
  CAIRN_ASSIGN_OR_RETURN(daemon->maps_, host::MapHost::Open(maps));
  CAIRN_RETURN_IF_ERROR(daemon->Listen(options));
  return daemon;
}

absl::Status Daemon::Listen(const DaemonOptions& options) {
  metrics_ =
      std::make_unique<Metrics>([maps = maps_.get(), access = access_.get()] { return StateOf(*maps, *access); });
  CallContext context{maps_.get(), options.images, metrics_.get(), access_.get()};
  context.status = metrics_.get();
  context.maps_folder = &maps_->directory();
  CAIRN_ASSIGN_OR_RETURN(const std::optional<ServerTls> tls, TlsOf(options.tls));
  if (!options.no_http) {
    const HttpHooks hooks{[this]() -> absl::Status {
                            CAIRN_RETURN_IF_ERROR(maps_->Ready());
                            return access_->Ready();
                          },
                          [this] { return metrics_->Text(); }, options.geopose_map};
    http_api_ = std::make_unique<HttpApi>(context, hooks, options.cors);
    HttpServerOptions http = options.http;
    http.tls = tls;
    http.gate = [api = http_api_.get()](const HttpRequest& request) { return api->Refusal(request); };
    http.on_refused = [api = http_api_.get()](const HttpRequest& received, const absl::Status& why, int status) {
      return api->AnswerRefused(received, why, status);
    };
    http.max_body_bytes = options.grpc.max_message_bytes;
    http.body_setting = "--max-message-mb";
    const auto handle = [api = http_api_.get()](const HttpRequest& request) { return api->Handle(request); };
    CAIRN_ASSIGN_OR_RETURN(http_, OncePortIsFree([&] { return HttpServer::Start(http, handle); }));
    http_address_ = Bound(options.http.address, http_->port());
  }
  CAIRN_RETURN_IF_ERROR(CheckSocketIsFree(options.grpc.address));
  GrpcServerOptions grpc = options.grpc;
  grpc.tls = tls;
  CAIRN_ASSIGN_OR_RETURN(grpc_, OncePortIsFree([&] { return GrpcServer::Start(grpc, context); }));
  grpc_address_ = Bound(options.grpc.address, grpc_->port());
  return absl::OkStatus();
}

Daemon::~Daemon() { Stop(std::chrono::milliseconds(0)); }

void Daemon::Tick(std::chrono::steady_clock::time_point now) {
  maps_->CloseIdle(now);
  const bool held = std::exchange(holds_maps_, !maps_->OpenMaps().empty());
#ifdef __GLIBC__
  // Back to the system, when nobody is there to wait for it.
  if (held && !holds_maps_) malloc_trim(0);
#else
  (void)held;
#endif
}

void Daemon::Stop(std::chrono::milliseconds grace) {
  const auto until = std::chrono::steady_clock::now() + grace;
  if (access_ != nullptr) access_->BeginStop();
  if (http_api_ != nullptr) http_api_->Stop();
  if (maps_ != nullptr) maps_->Hurry();
  if (access_ != nullptr) access_->limits().Stop();
  if (grpc_ != nullptr) grpc_->Stop(grace);
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
  if (http_ != nullptr) http_->Stop(std::max(left, std::chrono::milliseconds(0)));
  if (access_ != nullptr) access_->RecordCutOff();
}

}  // namespace cairn::server
