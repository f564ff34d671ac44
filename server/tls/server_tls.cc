#include "server/tls/server_tls.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <ctime>
#include <memory>
#include <utility>
#include <vector>

#include "base/files.h"

namespace cairn::server {
namespace {

constexpr std::uint64_t kMaxPemBytes = 1 << 20;

template <auto Free>
struct Freed {
  template <class T>
  void operator()(T* object) const {
    Free(object);
  }
};
using Certificate = std::unique_ptr<X509, Freed<X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Freed<EVP_PKEY_free>>;
using Bio = std::unique_ptr<BIO, Freed<BIO_free_all>>;

// Nobody is asked for a password.
int NoPassword(char* /*buffer*/, int /*size*/, int /*writes*/, void* /*data*/) { return -1; }

Bio Reader(const std::string& pem) { return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size()))); }

absl::StatusOr<std::vector<Certificate>> CertificatesOf(const std::string& pem, const std::string& file) {
  const Bio bio = Reader(pem);
  std::vector<Certificate> certificates;
  while (X509* certificate = PEM_read_bio_X509(bio.get(), nullptr, &NoPassword, nullptr)) {
    certificates.emplace_back(certificate);
  }
  ERR_clear_error();
  if (certificates.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(file, ": there is no certificate in it (PEM: -----BEGIN CERTIFICATE-----)"));
  }
  return certificates;
}

absl::StatusOr<Key> KeyOf(const std::string& pem, const std::string& file) {
  Key key(PEM_read_bio_PrivateKey(Reader(pem).get(), nullptr, &NoPassword, nullptr));
  ERR_clear_error();
  if (key != nullptr) return key;
  return absl::InvalidArgumentError(
      absl::StrCat(file, ": there is no private key in it (PEM: -----BEGIN PRIVATE KEY-----), or it has a password"));
}

std::int64_t UnixSecondsOf(const ASN1_TIME* time) {
  std::tm utc = {};
  return ASN1_TIME_to_tm(time, &utc) == 1 ? static_cast<std::int64_t>(timegm(&utc)) : 0;
}

std::string TimeText(std::int64_t unix_s) {
  const std::time_t time = static_cast<std::time_t>(unix_s);
  std::tm utc = {};
  gmtime_r(&time, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

absl::Status CheckValidNow(const X509* certificate, const std::string& file, std::int64_t now_unix_s) {
  const std::int64_t from = UnixSecondsOf(X509_get0_notBefore(certificate));
  const std::int64_t until = UnixSecondsOf(X509_get0_notAfter(certificate));
  if (now_unix_s > until) {
    return absl::FailedPreconditionError(
        absl::StrCat(file, ": the certificate has expired, on ", TimeText(until), ": get a new one"));
  }
  if (now_unix_s < from) {
    return absl::FailedPreconditionError(absl::StrCat(file, ": the certificate is valid from ", TimeText(from),
                                                      " only: is this machine's clock right?"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> Read(const std::string& path, absl::string_view what) {
  absl::StatusOr<std::string> pem = ReadWholeFile(path, kMaxPemBytes);
  if (!pem.ok()) return Annotate(pem.status(), what);
  return pem;
}

}  // namespace

absl::Status TlsOptions::Validate() const {
  if (certificate.empty() != key.empty()) {
    return absl::InvalidArgumentError("tls: give both tls_certificate and tls_key, or none of them");
  }
  if (!client_ca.empty() && !on()) return absl::InvalidArgumentError("tls: tls_client_ca needs tls_certificate");
  return absl::OkStatus();
}

absl::StatusOr<ServerTls> LoadServerTls(const TlsOptions& options, std::int64_t now_unix_s) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  ServerTls tls;
  CAIRN_ASSIGN_OR_RETURN(tls.certificates_pem, Read(options.certificate, "tls_certificate"));
  CAIRN_ASSIGN_OR_RETURN(tls.key_pem, Read(options.key, "tls_key"));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<Certificate> chain,
                         CertificatesOf(tls.certificates_pem, options.certificate));
  for (const Certificate& certificate : chain) {
    CAIRN_RETURN_IF_ERROR(CheckValidNow(certificate.get(), options.certificate, now_unix_s));
  }
  tls.expires_unix_s = UnixSecondsOf(X509_get0_notAfter(chain.front().get()));
  CAIRN_ASSIGN_OR_RETURN(const Key key, KeyOf(tls.key_pem, options.key));
  if (X509_check_private_key(chain.front().get(), key.get()) != 1) {
    ERR_clear_error();
    return absl::FailedPreconditionError(absl::StrCat(options.key, ": the key does not belong to the certificate of ",
                                                      options.certificate, " (its first one must be the server's)"));
  }
  if (options.client_ca.empty()) return tls;
  CAIRN_ASSIGN_OR_RETURN(tls.client_ca_pem, Read(options.client_ca, "tls_client_ca"));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<Certificate> authorities,
                         CertificatesOf(tls.client_ca_pem, options.client_ca));
  for (const Certificate& authority : authorities) {
    CAIRN_RETURN_IF_ERROR(CheckValidNow(authority.get(), options.client_ca, now_unix_s));
  }
  return tls;
}

}  // namespace cairn::server
