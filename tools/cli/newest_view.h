// A question to the newest revision of a map that others may write meanwhile.
#pragma once

#include "base/status.h"
#include "client/map_reader.h"
#include "store/fault.h"

namespace cairn::cli {

// ask(const tracking::MapView&), once more if what it looked at was written anew while it was read.
template <class Ask>
auto AskNewest(client::MapReader& reader, Ask ask) -> decltype(ask(*reader.view())) {
  auto answer = ask(*reader.view());
  if (answer.ok() || store::FaultOf(answer.status()) != store::Fault::kBusy) return answer;
  CAIRN_RETURN_IF_ERROR(reader.Refresh().status());
  return ask(*reader.view());
}

}  // namespace cairn::cli
