#include "server/daemon/settings.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "io/yaml_file.h"

namespace cairn::server {
namespace {

Setting Text(std::string key, std::string help, std::string* value) {
  return {std::move(key), std::move(help), false, *value, [value](absl::string_view text) {
            *value = std::string(text);
            return absl::OkStatus();
          }};
}

// Several texts, with commas.
Setting Texts(std::string key, std::string help, std::vector<std::string>* values) {
  return {std::move(key), std::move(help), false, absl::StrJoin(*values, ","), [values](absl::string_view text) {
            values->clear();
            for (const absl::string_view value : absl::StrSplit(text, ',', absl::SkipWhitespace())) {
              values->emplace_back(absl::StripAsciiWhitespace(value));
            }
            return absl::OkStatus();
          }};
}

Setting Flag(std::string key, std::string help, bool* value) {
  return {std::move(key), std::move(help), true, *value ? "true" : "false", [value](absl::string_view text) {
            return absl::SimpleAtob(text, value) ? absl::OkStatus()
                                                 : absl::InvalidArgumentError("must be true or false");
          }};
}

// A flag whose standard is true: it takes a value also on the command line.
Setting YesNo(std::string key, std::string help, bool* value) {
  Setting setting = Flag(std::move(key), std::move(help), value);
  setting.is_flag = false;
  return setting;
}

struct Range {
  double least = 0.0, most = 0.0;  // both are allowed
};

// Of what is written, so that people read what they wrote.
std::string NumberText(double number) { return absl::StrFormat("%.10g", number); }

// A number that is kept as `factor` times what is written; the range is of what is written.
template <class Number>
Setting Quantity(std::string key, std::string help, Range range, Number* value, double factor = 1.0) {
  return {std::move(key), std::move(help), false, absl::StrCat(static_cast<double>(*value) / factor),
          [value, range, factor](absl::string_view text) {
            double number = 0.0;
            if (!absl::SimpleAtod(text, &number) || !std::isfinite(number)) {
              return absl::InvalidArgumentError(absl::StrCat("must be a number, not \"", text, "\""));
            }
            const bool counts = std::is_integral_v<Number> && factor == 1.0;
            if (counts && number != std::round(number)) return absl::InvalidArgumentError("must be a whole number");
            if (number < range.least || number > range.most) {
              return absl::InvalidArgumentError(absl::StrCat("must be ", NumberText(range.least), " to ",
                                                             NumberText(range.most), ", not ", NumberText(number)));
            }
            *value = static_cast<Number>(number * factor);
            return absl::OkStatus();
          }};
}

std::string KeysOf(const std::vector<Setting>& settings) {
  return absl::StrJoin(settings, ", ", [](std::string* out, const Setting& setting) { out->append(setting.key); });
}

}  // namespace

std::vector<Setting> SettingsOf(DaemonOptions* options) {
  host::MapHostOptions& maps = options->maps;
  return {
      Text("maps", "Directory of the maps: NAME.cairn is served as NAME", &maps.directory),
      Text("listen", "HOST:PORT or unix:/path for gRPC; port 0: any that is free", &options->grpc.address),
      Text("listen_http", "HOST:PORT for HTTP: REST, health, metrics", &options->http.address),
      Flag("no_http", "gRPC only", &options->no_http),
      Flag("without_protection", "Listen also where other machines reach it, although TLS or tokens are missing",
           &options->without_protection),
      Text("tls_certificate", "PEM file: this server's certificate, and those between it and its CA",
           &options->tls.certificate),
      Text("tls_key", "PEM file: the key of the certificate", &options->tls.key),
      Text("tls_client_ca", "PEM file: clients need a certificate of one of these CAs, too", &options->tls.client_ca),
      Text("tokens", "File of who may do what (cairnd token create); then nobody gets in without a token",
           &options->access.tokens),
      Text("audit_log", "File: a line of JSON for every change, with who made it", &options->access.audit_log),
      YesNo("audit_sync", "Each line of it is on the disk before the client is answered (true, false)",
            &options->access.audit_sync),
      Text("request_log", "File: a line of JSON for every request", &options->access.request_log),
      Texts("cors_origins", "Origins of web pages that may ask over HTTP, with commas: https://maps.example.org, or *",
            &options->cors.origins),
      Quantity("max_client_sessions", "Sessions of one client at the same time, those included that wait for it",
               {1, 10'000}, &maps.max_client_sessions),
      Quantity("max_client_calls", "Calls and streams of one client at the same time", {1, 100'000},
               &options->access.limits.max_calls),
      Quantity("client_requests_per_s", "Requests of one client in a second", {1, 1e6},
               &options->access.limits.requests_per_s),
      Quantity("client_mb_per_s", "That one client may send in a second", {0.1, 1e5},
               &options->access.limits.bytes_per_s, 1e6),
      Text("geopose_map", "Map that the GeoPose Protocol asks; by default those near the position that a request names",
           &options->geopose_map),
      Quantity("memory_mb", "Of all open maps together, roughly; those used longest ago are closed first", {1, 1e7},
               &maps.memory_budget_bytes, 1e6),
      Quantity("idle_close_s", "A map that nobody has asked for so long is closed", {1, 1e7}, &maps.idle_close_s),
      Quantity("max_sessions", "Sessions at the same time", {1, 10'000}, &maps.max_sessions),
      Quantity("session_wait_s", "A session whose client is cut off waits so long for it, and is then finished",
               {0, 1e6}, &maps.session_wait_s),
      Quantity("workers", "Images that are located at the same time (0: as many as processors)", {0, 1024},
               &maps.workers),
      Quantity("max_waiting", "Images that wait to be located; more are refused", {0, 1e6}, &maps.max_waiting),
      Quantity("max_calls", "Calls and streams over gRPC at the same time; more are refused", {8, 10'000},
               &options->grpc.max_threads),
      Quantity("max_http_connections", "Further ones are closed at once", {1, 100'000}, &options->http.max_connections),
      Quantity("max_message_mb", "That a client may send at once", {0.0625, 1024}, &options->grpc.max_message_bytes,
               1 << 20),
      Quantity("max_image_megapixels", "Of an image; its header is checked before it is decoded", {0.01, 1000},
               &options->images.max_pixels, 1e6),
  };
}

absl::Status LoadSettings(const std::string& path, const std::vector<Setting>& settings) {
  CAIRN_ASSIGN_OR_RETURN(const YAML::Node root, io::LoadYamlMap(path));
  std::set<std::string> seen;
  for (const auto& entry : root) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
    const auto setting = std::ranges::find(settings, key, &Setting::key);
    if (setting == settings.end()) {
      return io::YamlError(path, entry.first, absl::StrCat("unknown key `", key, "`; there are ", KeysOf(settings)));
    }
    if (!seen.insert(key).second) return io::YamlError(path, entry.first, absl::StrCat("`", key, "` is repeated"));
    const absl::Status set =
        entry.second.IsScalar() ? setting->set(entry.second.Scalar()) : absl::InvalidArgumentError("takes one value");
    if (!set.ok()) return io::YamlError(path, entry.second, absl::StrCat("`", key, "` ", set.message()));
  }
  return absl::OkStatus();
}

}  // namespace cairn::server
