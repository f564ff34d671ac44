#include "server/grpc/answer.h"

#include <string>

#include "wire/errors.h"

namespace cairn::server {

grpc::Status ToGrpc(const Served& served) {
  if (served.status.ok()) return grpc::Status::OK;
  return {static_cast<grpc::StatusCode>(wire::KindOf(served.status).code), std::string(served.status.message()),
          wire::DetailsOf(served.status, served.request_id)};
}

}  // namespace cairn::server
