// The C functions: each reads the caller's structs, calls what the C++ headers have, and writes the answer.
#include <iterator>
#include <new>
#include <utility>

#include "base/guarded.h"
#include "base/status.h"
#include "base/version.h"
#include "cairn.h"
#include "client/boundary/c_handles.h"
#include "client/boundary/c_structs.h"

namespace cairn::client {
namespace {

static_assert(CAIRN_DATA_LOSS == static_cast<int>(absl::StatusCode::kDataLoss) &&
              CAIRN_UNAUTHENTICATED == static_cast<int>(absl::StatusCode::kUnauthenticated));

// Too short an error says nothing; there is nowhere to say that.
cairn_code Report(const absl::Status& status, cairn_error* error) noexcept {
  const auto code = static_cast<cairn_code>(status.code());
  if (error != nullptr && error->struct_size >= kFirstSize<cairn_error>) {
    error->code = code;
    WriteString(status.message(), error->message, sizeof(error->message));
  }
  return code;
}

template <class Work>
cairn_code Run(cairn_error* error, Work&& work) noexcept {
  return Report(Guarded(std::forward<Work>(work)), error);
}

absl::Status NullHandle(const char* what) {
  return absl::InvalidArgumentError(absl::StrCat(what, " must not be NULL"));
}

absl::Status CheckIndex(std::int32_t index, std::size_t count, const char* what) {
  if (index >= 0 && static_cast<std::size_t>(index) < count) return absl::OkStatus();
  return absl::OutOfRangeError(
      absl::StrCat("there is no ", what, " ", index, ": the map has ", count, " of them, from 0"));
}

}  // namespace
}  // namespace cairn::client

using cairn::client::CheckIndex;
using cairn::client::CheckOutput;
using cairn::client::NullHandle;
using cairn::client::Run;
using cairn::client::WriteStruct;

const char* cairn_version(void) { return cairn::kVersion; }

const char* cairn_code_name(cairn_code code) {
  static constexpr const char* kNames[] = {
      "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
      "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
      "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
      "DATA_LOSS", "UNAUTHENTICATED"};
  if (code < 0 || code >= static_cast<cairn_code>(std::size(kNames))) return "UNKNOWN";
  return kNames[code];
}

const char* cairn_localize_stage_name(int32_t stage) {
  return cairn::v0::LocalizeStageName(static_cast<cairn::v0::LocalizeStage>(stage));
}

const char* cairn_track_state_name(int32_t state) {
  return cairn::v0::TrackStateName(static_cast<cairn::v0::TrackState>(state));
}

cairn_cancellation* cairn_cancellation_new(void) { return new (std::nothrow) cairn_cancellation; }

void cairn_cancellation_cancel(cairn_cancellation* cancellation) {
  if (cancellation != nullptr) cancellation->cancellation.Cancel();
}

void cairn_cancellation_free(cairn_cancellation* cancellation) { delete cancellation; }

cairn_code cairn_map_open(const char* path, const cairn_map_options* options, const cairn_call_options* call,
                          cairn_map** map, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (path == nullptr) return NullHandle("path");
    if (map == nullptr) return NullHandle("map");
    CAIRN_ASSIGN_OR_RETURN(const auto map_options, cairn::client::ReadMapOptions(options));
    CAIRN_ASSIGN_OR_RETURN(const auto call_options, cairn::client::ReadCall(call));
    CAIRN_ASSIGN_OR_RETURN(auto opened, cairn::v0::Map::Open(path, map_options, call_options));
    *map = new cairn_map{std::move(opened)};
    return absl::OkStatus();
  });
}

void cairn_map_close(cairn_map* map) { delete map; }

cairn_code cairn_map_get_info(const cairn_map* map, cairn_map_info* info, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (map == nullptr) return NullHandle("map");
    CAIRN_RETURN_IF_ERROR(CheckOutput(info, "cairn_map_info"));
    CAIRN_ASSIGN_OR_RETURN(const auto found, map->map.Info());
    WriteStruct(cairn::client::ToC(found), info);
    return absl::OkStatus();
  });
}

cairn_code cairn_map_get_camera(const cairn_map* map, int32_t index, cairn_camera* camera, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (map == nullptr) return NullHandle("map");
    CAIRN_RETURN_IF_ERROR(CheckOutput(camera, "cairn_camera"));
    CAIRN_ASSIGN_OR_RETURN(const auto info, map->map.Info());
    CAIRN_RETURN_IF_ERROR(CheckIndex(index, info.cameras.size(), "camera"));
    WriteStruct(cairn::client::ToC(info.cameras[static_cast<std::size_t>(index)].camera), camera);
    return absl::OkStatus();
  });
}

cairn_code cairn_map_get_component(const cairn_map* map, int32_t index, cairn_component* component,
                                   cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (map == nullptr) return NullHandle("map");
    CAIRN_RETURN_IF_ERROR(CheckOutput(component, "cairn_component"));
    CAIRN_ASSIGN_OR_RETURN(const auto info, map->map.Info());
    CAIRN_RETURN_IF_ERROR(CheckIndex(index, info.components.size(), "component"));
    WriteStruct(cairn::client::ToC(info.components[static_cast<std::size_t>(index)]), component);
    return absl::OkStatus();
  });
}

cairn_code cairn_map_refresh(const cairn_map* map, const cairn_call_options* call, int32_t* changed,
                             cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (map == nullptr) return NullHandle("map");
    CAIRN_ASSIGN_OR_RETURN(const auto call_options, cairn::client::ReadCall(call));
    CAIRN_ASSIGN_OR_RETURN(const bool newer, map->map.Refresh(call_options));
    if (changed != nullptr) *changed = newer ? 1 : 0;
    return absl::OkStatus();
  });
}

cairn_code cairn_localizer_new(const cairn_map* map, cairn_localizer** localizer, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (map == nullptr) return NullHandle("map");
    if (localizer == nullptr) return NullHandle("localizer");
    CAIRN_ASSIGN_OR_RETURN(auto made, map->map.NewLocalizer());
    *localizer = new cairn_localizer{std::move(made)};
    return absl::OkStatus();
  });
}

void cairn_localizer_free(cairn_localizer* localizer) { delete localizer; }

cairn_code cairn_localizer_localize(const cairn_localizer* localizer, const cairn_localize_query* query,
                                    const cairn_call_options* call, cairn_localize_answer* answer, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (localizer == nullptr) return NullHandle("localizer");
    CAIRN_RETURN_IF_ERROR(CheckOutput(answer, "cairn_localize_answer"));
    CAIRN_ASSIGN_OR_RETURN(const auto known, cairn::client::ReadQuery(query));
    CAIRN_ASSIGN_OR_RETURN(const auto call_options, cairn::client::ReadCall(call));
    CAIRN_ASSIGN_OR_RETURN(const auto found, localizer->localizer.Localize(known, call_options));
    WriteStruct(cairn::client::ToC(found), answer);
    return absl::OkStatus();
  });
}

cairn_code cairn_tracker_new(const cairn_map* map, const cairn_camera* camera, const cairn_tracker_options* options,
                             const cairn_call_options* call, cairn_tracker** tracker, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (map == nullptr) return NullHandle("map");
    if (tracker == nullptr) return NullHandle("tracker");
    CAIRN_ASSIGN_OR_RETURN(const auto known_camera, cairn::client::ReadCamera(camera));
    CAIRN_ASSIGN_OR_RETURN(const auto tracker_options, cairn::client::ReadTrackerOptions(options));
    CAIRN_ASSIGN_OR_RETURN(const auto call_options, cairn::client::ReadCall(call));
    CAIRN_ASSIGN_OR_RETURN(auto made, map->map.NewTracker(known_camera, tracker_options, call_options));
    *tracker = new cairn_tracker{std::move(made)};
    return absl::OkStatus();
  });
}

void cairn_tracker_free(cairn_tracker* tracker) { delete tracker; }

cairn_code cairn_tracker_track(cairn_tracker* tracker, const cairn_image* image, int64_t time_ns,
                               const cairn_call_options* call, cairn_track_answer* answer, cairn_error* error) {
  return Run(error, [&]() -> absl::Status {
    if (tracker == nullptr) return NullHandle("tracker");
    CAIRN_RETURN_IF_ERROR(CheckOutput(answer, "cairn_track_answer"));
    CAIRN_ASSIGN_OR_RETURN(const auto view, cairn::client::ReadImage(image));
    CAIRN_ASSIGN_OR_RETURN(const auto call_options, cairn::client::ReadCall(call));
    CAIRN_ASSIGN_OR_RETURN(const auto found, tracker->tracker.Track(view, time_ns, call_options));
    WriteStruct(cairn::client::ToC(found), answer);
    return absl::OkStatus();
  });
}
