// The columns of the tables, of format 4 and of those before.
#include <algorithm>
#include <array>
#include <span>

#include "store/tables.h"

namespace cairn::store {
namespace {

using StringView = absl::string_view;

constexpr std::array<StringView, 33> kMapColumns = {
    "id",
    "map_id",
    "name",
    "software_version",
    "created_unix_ns",
    "orb_num_features",
    "orb_num_levels",
    "orb_scale_factor",
    "orb_fast_threshold",
    "orb_min_fast_threshold",
    "vocabulary_hash",
    "revision",
    "next_keyframe",
    "next_point",
    "keyframe_count",
    "point_count",
    "covisibility_count",
    "log_token",
    "previous_log_token",
    "log_schema_cookie",
    "next_camera",
    "next_session",
    "next_component",
    "geo_latitude_deg",
    "geo_longitude_deg",
    "geo_height_m",
    "geo_enu_from_world_qx",
    "geo_enu_from_world_qy",
    "geo_enu_from_world_qz",
    "geo_enu_from_world_qw",
    "info_revision",
    "oldest_delta_base",
    "row_checksum",
};
constexpr std::array<StringView, 18> kCamerasColumns = {
    "id",
    "name",
    "model",
    "width_px",
    "height_px",
    "fx_px",
    "fy_px",
    "cx_px",
    "cy_px",
    "distortion",
    "pinhole_width_px",
    "pinhole_height_px",
    "pinhole_fx_px",
    "pinhole_fy_px",
    "pinhole_cx_px",
    "pinhole_cy_px",
    "revision",
    "row_checksum",
};
constexpr std::array<StringView, 5> kLensesColumns = {"camera", "focal_scale", "k1", "k2", "row_checksum"};
constexpr std::array<StringView, 16> kSessionsColumns = {
    "id",      "camera",          "source",        "software_version", "settings_json", "first_ns",
    "last_ns", "started_unix_ns", "ended_unix_ns", "complete",         "removed",       "policy",
    "result",  "components",      "revision",      "row_checksum",
};
constexpr std::array<StringView, 29> kComponentsColumns = {
    "id",
    "session",
    "world_from_component_scale",
    "world_from_component_qx",
    "world_from_component_qy",
    "world_from_component_qz",
    "world_from_component_qw",
    "world_from_component_tx",
    "world_from_component_ty",
    "world_from_component_tz",
    "joined_into",
    "into_from_component_scale",
    "into_from_component_qx",
    "into_from_component_qy",
    "into_from_component_qz",
    "into_from_component_qw",
    "into_from_component_tx",
    "into_from_component_ty",
    "into_from_component_tz",
    "joined_keyframe",
    "joined_into_keyframe",
    "joined_keyframe_time_ns",
    "joined_matches",
    "joined_keyframes_agreeing",
    "joined_keyframes_checked",
    "joined_revision",
    "joined_unix_ns",
    "revision",
    "row_checksum",
};
constexpr std::array<StringView, 4> kTouchedColumns = {"revision", "kind", "ids_checksum", "ids"};
constexpr std::array<StringView, 12> kLoopsColumns = {
    "session", "number", "keyframe", "keyframe_time_ns", "loop_keyframe", "loop_time_ns",
    "matches", "scale",  "shift",    "turn_rad",         "way",           "row_checksum",
};
constexpr std::array<StringView, 6> kTrajectoriesColumns = {
    "session", "refined", "keyframes", "collinear", "reason", "row_checksum",
};
constexpr std::array<StringView, 24> kKeyframesColumns = {
    "id",
    "session",
    "camera",
    "time_ns",
    "frame_index",
    "camera_from_map_qx",
    "camera_from_map_qy",
    "camera_from_map_qz",
    "camera_from_map_qw",
    "camera_from_map_tx",
    "camera_from_map_ty",
    "camera_from_map_tz",
    "camera_from_direct_qx",
    "camera_from_direct_qy",
    "camera_from_direct_qz",
    "camera_from_direct_qw",
    "camera_from_direct_tx",
    "camera_from_direct_ty",
    "camera_from_direct_tz",
    "direct_segment",
    "parent",
    "component",
    "revision",
    "row_checksum",
};
constexpr std::array<StringView, 9> kPointsColumns = {
    "id", "x", "y", "z", "reference_keyframe", "times_visible", "times_found", "revision", "row_checksum",
};
constexpr std::array<StringView, 4> kCovisibilityColumns = {
    "keyframe_a",
    "keyframe_b",
    "shared_points",
    "row_checksum",
};
constexpr std::array<StringView, 16> kChangesColumns = {
    "revision",        "reason",         "committed_unix_ns", "keyframes_put",      "keyframes_removed",
    "points_put",      "points_removed", "session",           "components",         "cameras_put",
    "cameras_removed", "sessions_put",   "components_put",    "components_removed", "info_put",
    "row_checksum",
};
constexpr std::array<StringView, 11> kFeaturesColumns = {
    "keyframe",       "feature_count", "keypoint_layout", "word_bytes", "keypoints_checksum", "descriptors_checksum",
    "words_checksum", "keypoints",     "descriptors",     "words",      "revision",
};
constexpr std::array<StringView, 4> kKeyframePointsColumns = {
    "keyframe",
    "point_ids_checksum",
    "point_ids",
    "revision",
};
constexpr std::array<StringView, 3> kVocabularyColumns = {"id", "bytes_checksum", "bytes"};

// Before format 4 the whole map had one place in the world, and nothing that came with components and the log.
constexpr std::array<StringView, 8> kWorldFromMapColumns = {
    "world_from_map_scale", "world_from_map_qx", "world_from_map_qy", "world_from_map_qz",
    "world_from_map_qw",    "world_from_map_tx", "world_from_map_ty", "world_from_map_tz",
};
constexpr auto kMapColumnsBefore4 = [] {
  constexpr auto kRevision = std::ranges::find(kMapColumns, "revision");
  constexpr auto kNew = std::ranges::find(kMapColumns, "log_token");
  std::array<StringView, kNew - kMapColumns.begin() + kWorldFromMapColumns.size() + 1> columns;
  auto end = std::copy(kMapColumns.begin(), kRevision, columns.begin());
  end = std::copy(kWorldFromMapColumns.begin(), kWorldFromMapColumns.end(), end);
  end = std::copy(kRevision, kNew, end);
  *end = kMapColumns.back();
  return columns;
}();

}  // namespace

constinit const TableSpec kMapTable{"map", kMapColumns, 1, 0, kMapColumnsBefore4};
constinit const TableSpec kCamerasTable{"cameras", kCamerasColumns, 1, 1};
constinit const TableSpec kLensesTable{"lenses", kLensesColumns};
constinit const TableSpec kSessionsTable{"sessions", kSessionsColumns, 1, 5};
constinit const TableSpec kComponentsTable{"components", kComponentsColumns};
constinit const TableSpec kLoopsTable{"loops", kLoopsColumns, 2};
constinit const TableSpec kTrajectoriesTable{"reported_trajectories", kTrajectoriesColumns};
constinit const TableSpec kKeyframesTable{"keyframes", kKeyframesColumns, 1, 2};
constinit const TableSpec kPointsTable{"points", kPointsColumns, 1, 1};
constinit const TableSpec kCovisibilityTable{"covisibility", kCovisibilityColumns, 2};
constinit const TableSpec kChangesTable{"changes", kChangesColumns, 1, 8};
constinit const TableSpec kFeaturesTable{"keyframe_features", kFeaturesColumns, 1, 0,
                                         std::span(kFeaturesColumns).first(10)};
constinit const TableSpec kKeyframePointsTable{"keyframe_points", kKeyframePointsColumns, 1, 0,
                                               std::span(kKeyframePointsColumns).first(3)};
constinit const TableSpec kVocabularyTable{"vocabulary", kVocabularyColumns};
constinit const TableSpec kTouchedTable{"touched", kTouchedColumns, 2};

}  // namespace cairn::store
