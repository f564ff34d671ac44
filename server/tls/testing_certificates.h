// Certificates for tests, made on the spot: a CA, and what it vouches for.
#pragma once

#include <openssl/ec.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <memory>
#include <string>

namespace cairn::server {

struct TestingCertificate {
  std::string certificate_pem;
  std::string key_pem;
  std::shared_ptr<EVP_PKEY> key;
  std::shared_ptr<X509> certificate;
};

struct TestingCertificateOptions {
  std::string name = "localhost";  // a DNS name; that one is 127.0.0.1, too
  bool is_ca = false;
  long valid_from_s = -3600, valid_until_s = 3600;  // from now
};

inline std::string PemOf(const auto& write) {
  BIO* bio = BIO_new(BIO_s_mem());
  write(bio);
  char* bytes = nullptr;
  const long size = BIO_get_mem_data(bio, &bytes);
  const std::string pem(bytes, static_cast<std::size_t>(size));
  BIO_free(bio);
  return pem;
}

// By `issuer`, or by itself.
inline TestingCertificate MakeTestingCertificate(const TestingCertificateOptions& options,
                                                 const TestingCertificate* issuer = nullptr) {
  static long serial = 0;
  TestingCertificate made;
  made.key.reset(EVP_EC_gen("P-256"), EVP_PKEY_free);
  made.certificate.reset(X509_new(), X509_free);
  X509* const certificate = made.certificate.get();
  X509_set_version(certificate, 2);
  ASN1_INTEGER_set(X509_get_serialNumber(certificate), ++serial);
  X509_gmtime_adj(X509_getm_notBefore(certificate), options.valid_from_s);
  X509_gmtime_adj(X509_getm_notAfter(certificate), options.valid_until_s);
  X509_set_pubkey(certificate, made.key.get());
  const std::string common_name = options.is_ca ? "Testing CA" : options.name;
  X509_NAME* subject = X509_get_subject_name(certificate);
  X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>(common_name.c_str()),
                             -1, -1, 0);
  X509_set_issuer_name(certificate, issuer != nullptr ? X509_get_subject_name(issuer->certificate.get()) : subject);
  const auto extend = [&](int kind, const std::string& value) {
    X509_EXTENSION* extension = X509V3_EXT_conf_nid(nullptr, nullptr, kind, value.c_str());
    X509_add_ext(certificate, extension, -1);
    X509_EXTENSION_free(extension);
  };
  extend(NID_basic_constraints, options.is_ca ? "critical,CA:TRUE" : "CA:FALSE");
  if (!options.is_ca) {
    const bool here = options.name == "localhost";
    extend(NID_subject_alt_name, "DNS:" + options.name + (here ? ",IP:127.0.0.1" : ""));
  }
  X509_sign(certificate, issuer != nullptr ? issuer->key.get() : made.key.get(), EVP_sha256());
  made.certificate_pem = PemOf([&](BIO* bio) { PEM_write_bio_X509(bio, certificate); });
  made.key_pem =
      PemOf([&](BIO* bio) { PEM_write_bio_PrivateKey(bio, made.key.get(), nullptr, nullptr, 0, nullptr, nullptr); });
  return made;
}

inline TestingCertificate MakeTestingCa() { return MakeTestingCertificate({.is_ca = true}); }

}  // namespace cairn::server
