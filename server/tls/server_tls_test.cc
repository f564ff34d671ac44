#include "server/tls/server_tls.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <ctime>
#include <filesystem>
#include <fstream>

#include "server/tls/testing_certificates.h"

namespace cairn::server {
namespace {

using testing::HasSubstr;

class ServerTlsTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = testing::TempDir() + "/server_tls_test_" + std::to_string(getpid());
    std::filesystem::create_directory(folder_);
    ca_ = MakeTestingCa();
    good_ = MakeTestingCertificate({}, &ca_);
    options_.certificate = File("certificate.pem", good_.certificate_pem);
    options_.key = File("key.pem", good_.key_pem);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string File(const std::string& name, const std::string& contents) const {
    std::ofstream(folder_ + "/" + name) << contents;
    return folder_ + "/" + name;
  }
  void IsRefused(absl::StatusCode code, const std::string& says) const {
    const absl::Status status = LoadServerTls(options_, std::time(nullptr)).status();
    EXPECT_EQ(status.code(), code) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(says));
  }

  std::string folder_;
  TestingCertificate ca_, good_;
  TlsOptions options_;
};

TEST_F(ServerTlsTest, TakesACertificateWithItsChainAndKey) {
  options_.certificate = File("chain.pem", "comment\n" + good_.certificate_pem + ca_.certificate_pem);
  options_.client_ca = File("ca.pem", ca_.certificate_pem);
  const absl::StatusOr<ServerTls> tls = LoadServerTls(options_, std::time(nullptr));
  ASSERT_TRUE(tls.ok()) << tls.status();
  EXPECT_THAT(tls->certificates_pem, HasSubstr(ca_.certificate_pem));
  EXPECT_EQ(tls->key_pem, good_.key_pem);
  EXPECT_EQ(tls->client_ca_pem, ca_.certificate_pem);
  EXPECT_NEAR(static_cast<double>(tls->expires_unix_s - std::time(nullptr)), 3600.0, 5.0);
}

TEST_F(ServerTlsTest, FilesThatAreNotThereOrSomethingElse) {
  options_.certificate = folder_ + "/none.pem";
  IsRefused(absl::StatusCode::kNotFound, "tls_certificate: reading " + options_.certificate);
  options_.certificate = File("certificate.pem", good_.key_pem);
  IsRefused(absl::StatusCode::kInvalidArgument, "there is no certificate in it");
  options_.certificate = File("certificate.pem", good_.certificate_pem);
  options_.key = File("key.pem", good_.certificate_pem);
  IsRefused(absl::StatusCode::kInvalidArgument, "no private key in it");
  const std::string locked = PemOf([&](BIO* bio) {
    PEM_write_bio_PrivateKey(bio, good_.key.get(), EVP_aes_256_cbc(), reinterpret_cast<const unsigned char*>("pw"), 2,
                             nullptr, nullptr);
  });
  options_.key = File("key.pem", locked);
  IsRefused(absl::StatusCode::kInvalidArgument, "or it has a password");
  options_.key = File("key.pem", good_.key_pem);
  options_.client_ca = File("ca.pem", "");
  IsRefused(absl::StatusCode::kInvalidArgument, "ca.pem: there is no certificate");
}

TEST_F(ServerTlsTest, CertificatesThatAreNotValidNowOrNotOfTheKey) {
  options_.key = File("key.pem", MakeTestingCertificate({}, &ca_).key_pem);
  IsRefused(absl::StatusCode::kFailedPrecondition, "the key does not belong to the certificate");
  TestingCertificate old = MakeTestingCertificate({.valid_from_s = -7200, .valid_until_s = -60}, &ca_);
  options_.certificate = File("certificate.pem", old.certificate_pem);
  options_.key = File("key.pem", old.key_pem);
  IsRefused(absl::StatusCode::kFailedPrecondition, "has expired");
  TestingCertificate early = MakeTestingCertificate({.valid_from_s = 600}, &ca_);
  options_.certificate = File("certificate.pem", early.certificate_pem);
  options_.key = File("key.pem", early.key_pem);
  IsRefused(absl::StatusCode::kFailedPrecondition, "is this machine's clock right?");
}

TEST_F(ServerTlsTest, HalfOfItIsAMistake) {
  EXPECT_TRUE(TlsOptions().Validate().ok());
  options_.key = "";
  IsRefused(absl::StatusCode::kInvalidArgument, "both tls_certificate and tls_key");
  options_ = {};
  options_.client_ca = "ca.pem";
  EXPECT_EQ(options_.Validate().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::server
