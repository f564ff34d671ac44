#include "client/remote/client_tls.h"

#include "absl/strings/match.h"
#include "base/files.h"

namespace cairn::client {
namespace {

constexpr std::uint64_t kMaxPemBytes = 1 << 20;

// `kind`: as it stands in the first line. Empty if there is no such file.
absl::StatusOr<std::string> ReadPem(const std::string& path, absl::string_view kind) {
  if (path.empty()) return std::string();
  CAIRN_ASSIGN_OR_RETURN(std::string pem, ReadWholeFile(path, kMaxPemBytes));
  if (absl::StrContains(pem, "-----BEGIN ") && absl::StrContains(pem, absl::StrCat(kind, "-----"))) return pem;
  return absl::InvalidArgumentError(absl::StrCat(path, ": there is no ", kind, " in it, in PEM format"));
}

}  // namespace

absl::StatusOr<std::optional<ClientTls>> LoadClientTls(const ClientTlsFiles& files) {
  std::optional<ClientTls> tls;
  if (!files.on) return tls;
  if (files.certificate.empty() != files.key.empty()) {
    return absl::InvalidArgumentError("a certificate needs its key, and the other way round");
  }
  tls.emplace();
  CAIRN_ASSIGN_OR_RETURN(tls->ca_pem, ReadPem(files.ca, "CERTIFICATE"));
  CAIRN_ASSIGN_OR_RETURN(tls->certificate_pem, ReadPem(files.certificate, "CERTIFICATE"));
  CAIRN_ASSIGN_OR_RETURN(tls->key_pem, ReadPem(files.key, "PRIVATE KEY"));
  return tls;
}

}  // namespace cairn::client
