#include "client/remote/client_tls.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <memory>

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

// The server would hang up without a word. What cannot be read here is left to who uses it.
absl::Status CheckBelongTogether(const ClientTlsFiles& files, const ClientTls& tls) {
  const auto no_password = [](char*, int, int, void*) { return -1; };
  const auto reader = [](const std::string& pem) {
    return std::unique_ptr<BIO, decltype(&BIO_free_all)>(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())),
                                                         &BIO_free_all);
  };
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(
      PEM_read_bio_X509(reader(tls.certificate_pem).get(), nullptr, no_password, nullptr), &X509_free);
  const std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key(
      PEM_read_bio_PrivateKey(reader(tls.key_pem).get(), nullptr, no_password, nullptr), &EVP_PKEY_free);
  const bool differ =
      certificate != nullptr && key != nullptr && X509_check_private_key(certificate.get(), key.get()) != 1;
  ERR_clear_error();
  if (!differ) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat(files.key, ": the key (--key) does not belong to the certificate (--cert) of ", files.certificate));
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
  CAIRN_RETURN_IF_ERROR(CheckBelongTogether(files, *tls));
  return tls;
}

}  // namespace cairn::client
