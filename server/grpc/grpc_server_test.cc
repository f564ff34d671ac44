#include "server/grpc/grpc_server.h"

#include <cairn/v1/localize.grpc.pb.h>
#include <cairn/v1/maps.grpc.pb.h>
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/codegen/client_unary_call.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <thread>

#include "client/conformance/conformance_map.h"
#include "server/grpc/testing_server.h"

namespace cairn::server {
namespace {

class GrpcServerTest : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = testing::TempDir() + "/grpc_server_test_" + std::to_string(getpid());
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directory(directory_);
    ASSERT_TRUE(conformance::WriteConformanceMap(directory_ + "/room.cairn").ok());
    Start({});
  }
  void TearDown() override {
    server_.reset();
    std::filesystem::remove_all(directory_);
  }
  void Start(const GrpcServerOptions& options) {
    auto server = TestingServer::Start(directory_, options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    channel_ = grpc::CreateChannel(server_->Remote().server, grpc::InsecureChannelCredentials());
  }

  // One message of these bytes to a call, and nothing after it.
  grpc::Status Send(const std::string& path, const std::string& bytes) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    const grpc::internal::RpcMethod method(path.c_str(), grpc::internal::RpcMethod::BIDI_STREAMING);
    const std::unique_ptr<grpc::ClientReaderWriter<grpc::ByteBuffer, grpc::ByteBuffer>> stream(
        grpc::internal::ClientReaderWriterFactory<grpc::ByteBuffer, grpc::ByteBuffer>::Create(channel_.get(), method,
                                                                                              &context));
    const grpc::Slice slice(bytes);
    stream->Write(grpc::ByteBuffer(&slice, 1));
    stream->WritesDone();
    grpc::ByteBuffer answer;
    while (stream->Read(&answer)) {
    }
    return stream->Finish();
  }

  std::string directory_;
  std::unique_ptr<TestingServer> server_;
  std::shared_ptr<grpc::Channel> channel_;
};

TEST_F(GrpcServerTest, ErrorsCarryTheirReasonAndARequestId) {
  grpc::ClientContext context;
  v1::DescribeMapRequest request;
  request.set_map("kitchen");
  v1::DescribeMapResponse response;
  const grpc::Status status = v1::Maps::NewStub(channel_)->DescribeMap(&context, request, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  v1::ErrorDetail detail;
  ASSERT_TRUE(detail.ParseFromString(status.error_details()));
  EXPECT_EQ(detail.reason(), "map_not_found");
  EXPECT_FALSE(detail.request_id().empty());
}

TEST_F(GrpcServerTest, LocatesAPngAndRefusesWhatIsNoImage) {
  const conformance::ConformanceMap& map = conformance::TheConformanceMap();
  v1::LocalizeImageRequest request;
  request.set_map("room");
  v1::Camera* camera = request.mutable_camera();
  camera->set_model(v1::Camera::MODEL_PINHOLE);
  camera->set_width_px(map.pinhole.width_px);
  camera->set_height_px(map.pinhole.height_px);
  camera->set_fx_px(map.pinhole.fx_px);
  camera->set_fy_px(map.pinhole.fy_px);
  camera->set_cx_px(map.pinhole.cx_px);
  camera->set_cy_px(map.pinhole.cy_px);
  const auto locate = [&](v1::LocalizeImageResponse* response) {
    grpc::ClientContext context;
    return v1::Localize::NewStub(channel_)->LocalizeImage(&context, request, response);
  };
  v1::LocalizeImageResponse response;
  EXPECT_EQ(locate(&response).error_code(), grpc::StatusCode::INVALID_ARGUMENT) << "no image";
  request.mutable_image()->set_encoded("\xFF\xD8 no jpeg");
  EXPECT_EQ(locate(&response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  const cv::Mat gray = map.room.Render(map.pinhole, conformance::LookInRoom({0.2, 0.0, -1.4}, 0.05));
  std::string* rgb = request.mutable_image()->mutable_rgb();
  for (std::size_t i = 0; i < gray.total(); ++i) rgb->append(3, static_cast<char>(gray.data[i]));
  const grpc::Status status = locate(&response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(response.localized()) << response.reason();
  camera->clear_model();
  EXPECT_EQ(locate(&response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(GrpcServerTest, MessagesBeyondTheLimitAreRefusedAndTheServerGoesOn) {
  GrpcServerOptions options;
  options.max_message_bytes = 1 << 20;
  Start(options);
  v1::LocalizeImageRequest request;
  request.set_map("room");
  request.mutable_image()->set_gray(std::string(2 << 20, 'x'));
  {
    grpc::ClientContext context;
    v1::LocalizeImageResponse response;
    EXPECT_EQ(v1::Localize::NewStub(channel_)->LocalizeImage(&context, request, &response).error_code(),
              grpc::StatusCode::RESOURCE_EXHAUSTED);
  }
  {
    const auto service = *client::RemoteMapService::Connect(server_->Remote());
    api::LocalizeQuery query;
    query.image = cv::Mat(2000, 1000, CV_8UC1, cv::Scalar(90));
    query.camera = Camera::FromPinhole({1000, 2000, 500.0, 500.0, 500.0, 1000.0});
    const absl::Status told = service->Localize("room", query).status();
    EXPECT_TRUE(absl::IsResourceExhausted(told)) << told;
    EXPECT_THAT(std::string(told.message()), testing::HasSubstr("takes messages of 1.00 MB at most"));
    EXPECT_THAT(std::string(told.message()), testing::HasSubstr("--max-message-mb"));
  }
  grpc::ClientContext context;
  v1::ListMapsResponse response;
  EXPECT_TRUE(v1::Maps::NewStub(channel_)->ListMaps(&context, {}, &response).ok());
  EXPECT_EQ(response.maps_size(), 1);
}

// gRPC unpacks before it looks at the size: 64 MB could become as many GB.
TEST_F(GrpcServerTest, PackedMessagesAreRefusedBeforeTheyAreUnpacked) {
  GrpcServerOptions options;
  options.max_message_bytes = 1 << 20;
  Start(options);
  v1::LocalizeImageRequest request;
  request.set_map("room");
  request.mutable_image()->set_gray(std::string(8 << 20, '\0'));
  for (const auto packed : {GRPC_COMPRESS_GZIP, GRPC_COMPRESS_DEFLATE}) {
    grpc::ClientContext context;
    context.set_compression_algorithm(packed);
    v1::LocalizeImageResponse response;
    const grpc::Status status = v1::Localize::NewStub(channel_)->LocalizeImage(&context, request, &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
  }
  grpc::ClientContext context;
  v1::ListMapsResponse response;
  EXPECT_TRUE(v1::Maps::NewStub(channel_)->ListMaps(&context, {}, &response).ok());
}

// Of every call: bytes that are no message, and a good one that ends too early.
TEST_F(GrpcServerTest, WhatIsNoMessageIsRefusedAndTheServerGoesOn) {
  v1::LocalizeImageRequest whole;
  whole.set_map("room");
  whole.mutable_image()->set_gray(std::string(100, 'x'));
  const std::string bytes = whole.SerializeAsString();
  const std::vector<std::string> messages = {bytes.substr(0, bytes.size() - 10), "\xff\xff\xff\xff",
                                             std::string(1000, '\x0a')};
  int calls = 0;
  for (const char* name : {"admin", "align", "follow", "localize", "maps", "sessions", "status", "track"}) {
    const auto* file =
        google::protobuf::DescriptorPool::generated_pool()->FindFileByName(absl::StrCat("cairn/v1/", name, ".proto"));
    ASSERT_NE(file, nullptr) << name;
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m, ++calls) {
        const auto* method = file->service(s)->method(m);
        const std::string path = absl::StrCat("/", file->service(s)->full_name(), "/", method->name());
        for (const std::string& message : messages) {
          const grpc::Status status = Send(path, message);
          EXPECT_FALSE(status.ok()) << path;
          EXPECT_NE(status.error_code(), grpc::StatusCode::UNAVAILABLE) << path << ": " << status.error_message();
          EXPECT_NE(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << path;
        }
      }
    }
  }
  EXPECT_GE(calls, 19);
  grpc::ClientContext context;
  v1::ListMapsResponse response;
  EXPECT_TRUE(v1::Maps::NewStub(channel_)->ListMaps(&context, {}, &response).ok());
}

// As grpcurl, load balancers and systemd ask.
TEST_F(GrpcServerTest, SaysThatItIsHealthy) {
  const grpc::internal::RpcMethod check("/grpc.health.v1.Health/Check", grpc::internal::RpcMethod::NORMAL_RPC);
  grpc::ClientContext context;
  const grpc::Slice empty;
  const grpc::ByteBuffer nothing(&empty, 1);  // of the server as a whole
  grpc::ByteBuffer response;
  const grpc::Status status = grpc::internal::BlockingUnaryCall<grpc::ByteBuffer, grpc::ByteBuffer>(
      channel_.get(), check, &context, nothing, &response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  grpc::Slice bytes;
  ASSERT_TRUE(response.DumpToSingleSlice(&bytes).ok());
  EXPECT_EQ(std::string(bytes.begin(), bytes.end()), "\x08\x01") << "status: SERVING";
}

// What is under way is answered; who comes later, or after the server has gone, is told so.
TEST_F(GrpcServerTest, StopsInOrder) {
  client::RemoteOptions remote = server_->Remote();
  remote.outage_s = 2.0;
  int waits = 0;
  remote.on_outage = [&](const absl::Status& /*why*/) { ++waits; };
  const auto service = client::RemoteMapService::Connect(remote);
  ASSERT_TRUE(service.ok());
  EXPECT_TRUE((*service)->List().ok());
  server_->grpc->Stop(std::chrono::seconds(3));
  const absl::Status gone = (*service)->List().status();
  EXPECT_EQ(gone.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(gone.message()), testing::HasSubstr("is cairnd running there?"));
  EXPECT_EQ(waits, 1) << "as it had answered before";
  const auto never = client::RemoteMapService::Connect(remote);
  EXPECT_EQ((*never)->List().status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(waits, 1) << "nobody has ever answered there";
}

TEST(RemoteMapService, ErrorsOfOptions) {
  client::RemoteOptions options;
  options.server = "";
  EXPECT_EQ(client::RemoteMapService::Connect(options).status().code(), absl::StatusCode::kInvalidArgument);
  options = {};
  options.deadline_s = 0.0;
  EXPECT_EQ(client::RemoteMapService::Connect(options).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::server
