#include "inspect/listing.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "inspect/measures.h"

namespace cairn::inspect {
namespace {

using Row = std::vector<Cell>;

std::int64_t Whole(std::size_t value) { return static_cast<std::int64_t>(value); }
template <class Tag>
Cell IdCell(Id<Tag> id) {
  return id ? Cell(static_cast<std::int64_t>(id.value())) : Cell();
}
Cell Known(const std::optional<double>& value) { return value ? Cell(*value) : Cell(); }

template <class Tag>
std::string JoinIds(const std::set<Id<Tag>>& ids) {
  return absl::StrJoin(ids, ",", [](std::string* out, Id<Tag> id) { absl::StrAppend(out, id.value()); });
}

Row RowOf(const map::Snapshot& map, const map::Keyframe& keyframe) {
  const Vector3d center = Placed(map, keyframe.component, keyframe.CenterInMap());
  const auto observations = Measure(map, keyframe);
  return {IdCell(keyframe.id),
          IdCell(keyframe.session),
          IdCell(keyframe.component),
          IdCell(keyframe.camera),
          ToSeconds(keyframe.time_ns),
          center.x(),
          center.y(),
          center.z(),
          Whole(keyframe.points.size()),
          std::int64_t{NumPoints(keyframe)},
          std::int64_t{NumCovisible(keyframe)},
          Known(ErrorRmsPx(observations)),
          observations.empty() ? Cell() : Cell(PlacedScale(map, keyframe.component) * MedianDepth(observations))};
}

Row RowOf(const map::Snapshot& map, const map::MapPoint& point) {
  const ComponentId component = ComponentOf(map, point);
  const Vector3d position = Placed(map, component, point.position);
  const map::Keyframe& reference = map.keyframe(point.reference.keyframe);
  const double depth = (point.position - reference.CenterInMap()).norm() * PlacedScale(map, component);
  const double found = point.times_visible > 0 ? 1.0 * point.times_found / point.times_visible : 0.0;
  return {IdCell(point.id),
          IdCell(component),
          IdCell(reference.id),
          position.x(),
          position.y(),
          position.z(),
          Whole(point.observations.size()),
          Known(ErrorRmsPx(map, point)),
          depth,
          ParallaxDeg(map, point),
          found};
}

template <class IdType, class Entity>
std::vector<Row> AllRows(const map::Snapshot& map, const map::Table<IdType, Entity>& table) {
  std::vector<Row> rows;
  table.ForEach([&](const auto& entity) { rows.push_back(RowOf(map, *entity)); });
  return rows;
}

// Rows that are asked for by their numbers, the only ones of a large map that are looked at.
template <class IdType, class Entity>
void FewRows(const map::Snapshot& map, const map::Table<IdType, Entity>& table, IdType end, const ListingQuery& query,
             Listing* listing) {
  listing->total = table.size();
  const auto add = [&](std::uint32_t id) {
    if (const Entity* entity = table.Find(IdType(id)); entity != nullptr) listing->rows.push_back(RowOf(map, *entity));
  };
  for (std::uint32_t i = 1; i < end.value() && listing->rows.size() < query.limit; ++i) {
    add(query.descending ? end.value() - i : i);
  }
}

std::vector<Row> SessionRows(const map::Snapshot& map) {
  std::map<SessionId, std::pair<std::int64_t, TimeNs>> keyframes;  // and the last of them
  std::map<SessionId, std::int64_t> points;
  map.keyframes().ForEach([&](const auto& keyframe) {
    auto& [count, last_ns] = keyframes[keyframe->session];
    ++count;
    last_ns = std::max(last_ns, keyframe->time_ns);
  });
  map.points().ForEach([&](const auto& point) { ++points[map.keyframe(point->reference.keyframe).session]; });
  std::vector<Row> rows;
  for (const auto& [id, session] : map.sessions()) {
    const auto& [count, last_ns] = keyframes[id];
    rows.push_back({IdCell(id), session.source, IdCell(session.camera), count, points[id],
                    ToSeconds(std::max({session.first_ns, session.last_ns, last_ns}) - session.first_ns),
                    Whole(session.loops.size()), std::string(map::SessionPolicyName(session.policy)),
                    session.complete ? Cell(std::string(map::SessionResultName(session.result))) : Cell(),
                    session.complete, session.removed});
  }
  return rows;
}

std::vector<Row> ComponentRows(const map::Snapshot& map) {
  std::map<ComponentId, std::set<SessionId>> sessions;
  std::map<ComponentId, std::int64_t> points;
  map.keyframes().ForEach([&](const auto& keyframe) { sessions[keyframe->component].insert(keyframe->session); });
  map.points().ForEach([&](const auto& point) { ++points[ComponentOf(map, *point)]; });
  std::vector<Row> rows;
  for (const auto& [id, component] : map.components()) {
    const auto& world = component.world_from_component;
    rows.push_back({IdCell(id), map.NumKeyframes(id), points[id], JoinIds(sessions[id]), world.has_value(),
                    world ? Cell(world->scale()) : Cell(), IdCell(component.session),
                    component.joined ? IdCell(component.joined->into) : Cell()});
  }
  return rows;
}

std::vector<Row> CameraRows(const map::Snapshot& map) {
  std::map<CameraId, std::int64_t> keyframes;
  std::map<CameraId, std::set<SessionId>> sessions;
  map.keyframes().ForEach([&](const auto& keyframe) { ++keyframes[keyframe->camera]; });
  for (const auto& [id, session] : map.sessions()) sessions[session.camera].insert(id);
  std::vector<Row> rows;
  for (const auto& [id, camera] : map.cameras()) {
    rows.push_back({IdCell(id), camera.name, std::string(CameraModelName(camera.model.model)),
                    std::int64_t{camera.model.width_px}, std::int64_t{camera.model.height_px}, camera.model.fx_px,
                    camera.model.fy_px, camera.lens.has_value(), keyframes[id], JoinIds(sessions[id])});
  }
  return rows;
}

std::vector<Row> RowsOf(const map::Snapshot& map, Kind kind) {
  switch (kind) {
    case Kind::kKeyframes:
      return AllRows(map, map.keyframes());
    case Kind::kPoints:
      return AllRows(map, map.points());
    case Kind::kSessions:
      return SessionRows(map);
    case Kind::kComponents:
      return ComponentRows(map);
    case Kind::kCameras:
      return CameraRows(map);
  }
  return {};
}

absl::StatusOr<std::size_t> FindColumn(const std::vector<Column>& columns, absl::string_view name) {
  std::size_t found = 0, at = 0;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (columns[i].name == name) return i;
    if (name.empty() || !absl::StartsWith(columns[i].name, name)) continue;
    ++found;
    at = i;
  }
  if (found == 1) return at;
  return absl::InvalidArgumentError(
      absl::StrCat("there is no column \"", name, "\"; there are ",
                   absl::StrJoin(columns, ", ", [](std::string* out, const Column& c) { out->append(c.name); })));
}

struct Filter {
  std::size_t column = 0;
  std::string op;
  std::string text;
  double number = 0.0;

  bool Fits(const Cell& cell) const {
    if (cell.kind == Cell::Kind::kNothing) return op == "!=";
    if (cell.kind == Cell::Kind::kText) {
      if (op == "~") return absl::StrContains(cell.text, text);
      return (cell.text == text) == (op == "=");
    }
    const double value = cell.Number();
    if (op == "=") return value == number;
    if (op == "!=") return value != number;
    if (op == "<") return value < number;
    if (op == "<=") return value <= number;
    return op == ">" ? value > number : value >= number;
  }
};

absl::StatusOr<Filter> ParseFilter(const std::vector<Column>& columns, const std::string& filter) {
  const std::size_t at = filter.find_first_of("=!<>~");
  if (at == std::string::npos || at == 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", filter, "\" is no filter: write it like points<50, session=2 or source~office"));
  }
  Filter parsed;
  CAIRN_ASSIGN_OR_RETURN(parsed.column, FindColumn(columns, absl::StripAsciiWhitespace(filter.substr(0, at))));
  std::size_t end = at + 1;
  if (end < filter.size() && filter[end] == '=' && filter[at] != '=' && filter[at] != '~') ++end;
  parsed.op = filter.substr(at, end - at);
  parsed.text = std::string(absl::StripAsciiWhitespace(filter.substr(end)));
  const bool text = columns[parsed.column].text;
  if (parsed.op == "!" || (text && parsed.op != "=" && parsed.op != "!=" && parsed.op != "~") ||
      (!text && parsed.op == "~")) {
    return absl::InvalidArgumentError(absl::StrCat(
        "\"", filter, "\": a column of ", text ? "texts takes =, != and ~" : "numbers takes =, !=, <, <=, > and >="));
  }
  if (text || absl::SimpleAtod(parsed.text, &parsed.number)) return parsed;
  if (parsed.text == "yes" || parsed.text == "no") {
    parsed.number = parsed.text == "yes" ? 1.0 : 0.0;
    return parsed;
  }
  return absl::InvalidArgumentError(absl::StrCat("\"", filter, "\": \"", parsed.text, "\" is no number"));
}

// What is not known comes last in any case.
bool Before(const Cell& a, const Cell& b, bool descending) {
  const bool knows_a = a.kind != Cell::Kind::kNothing, knows_b = b.kind != Cell::Kind::kNothing;
  if (!knows_a || !knows_b) return knows_a && !knows_b;
  const Cell &first = descending ? b : a, &second = descending ? a : b;
  return first.kind == Cell::Kind::kText ? first.text < second.text : first.Number() < second.Number();
}

}  // namespace

std::vector<Column> ColumnsOf(Kind kind) {
  const auto whole = [](const char* name, const char* brief = "") { return Column{name, false, 0, brief}; };
  const auto real = [](const char* name, int decimals, const char* brief = "") {
    return Column{name, false, decimals, brief};
  };
  const auto text = [](const char* name) { return Column{name, true, 0, ""}; };
  switch (kind) {
    case Kind::kKeyframes:
      return {whole("id"),
              whole("session", "ses"),
              whole("component", "com"),
              whole("camera", "cam"),
              real("time_s", 2),
              real("x", 2),
              real("y", 2),
              real("z", 2),
              whole("features", "feat"),
              whole("points"),
              whole("covisible", "covis"),
              real("error_px", 2, "error"),
              real("depth", 2)};
    case Kind::kPoints:
      return {whole("id"),
              whole("component", "comp"),
              whole("reference", "ref"),
              real("x", 3),
              real("y", 3),
              real("z", 3),
              whole("observations", "obs"),
              real("error_px", 2, "error"),
              real("depth", 2),
              real("parallax_deg", 1, "parallax"),
              real("found", 2)};
    case Kind::kSessions:
      return {whole("id"),
              text("source"),
              whole("camera", "cam"),
              whole("keyframes", "keyf"),
              whole("points"),
              real("duration_s", 1, "dur"),
              whole("loops"),
              text("policy"),
              text("result"),
              whole("complete", "comp"),
              whole("removed", "rem")};
    case Kind::kComponents:
      return {whole("id"),
              whole("keyframes"),
              whole("points"),
              text("sessions"),
              whole("aligned"),
              real("scale", 4),
              whole("begun_by_session", "begun_by"),
              whole("joined_into")};
    case Kind::kCameras:
      return {whole("id"),
              text("name"),
              text("model"),
              whole("width_px", "width"),
              whole("height_px", "height"),
              real("fx_px", 1, "fx"),
              real("fy_px", 1, "fy"),
              whole("lens_corrected", "lens"),
              whole("keyframes", "keyf"),
              text("sessions")};
  }
  return {};
}

absl::Status Arrange(const ListingQuery& query, Listing* listing) {
  CAIRN_ASSIGN_OR_RETURN(const std::size_t sort, FindColumn(listing->columns, query.sort));
  std::vector<Filter> filters;
  for (const std::string& filter : query.filters) {
    CAIRN_ASSIGN_OR_RETURN(Filter parsed, ParseFilter(listing->columns, filter));
    filters.push_back(std::move(parsed));
  }
  std::erase_if(listing->rows, [&](const Row& row) {
    return !std::ranges::all_of(filters, [&](const Filter& filter) { return filter.Fits(row[filter.column]); });
  });
  listing->total = listing->rows.size();
  std::ranges::stable_sort(listing->rows,
                           [&](const Row& a, const Row& b) { return Before(a[sort], b[sort], query.descending); });
  if (query.limit > 0 && listing->rows.size() > query.limit) listing->rows.resize(query.limit);
  return absl::OkStatus();
}

bool LooksAtFew(Kind kind, const ListingQuery& query) {
  return (kind == Kind::kKeyframes || kind == Kind::kPoints) && query.limit > 0 && query.filters.empty() &&
         query.sort == "id";
}

absl::StatusOr<Listing> List(const map::Snapshot& map, Kind kind, const ListingQuery& query) {
  Listing listing{ColumnsOf(kind), {}, 0};
  CAIRN_RETURN_IF_ERROR(Arrange(query, &listing));  // what is wrong with the query is told before the rows are made
  if (LooksAtFew(kind, query)) {
    if (kind == Kind::kKeyframes) FewRows(map, map.keyframes(), map.next_keyframe(), query, &listing);
    if (kind == Kind::kPoints) FewRows(map, map.points(), map.next_point(), query, &listing);
    return listing;
  }
  listing.rows = RowsOf(map, kind);
  CAIRN_RETURN_IF_ERROR(Arrange(query, &listing));
  return listing;
}

std::optional<Listing> ListOne(const map::Snapshot& map, Kind kind, std::uint32_t id) {
  Listing listing{ColumnsOf(kind), {}, 1};
  if (kind == Kind::kKeyframes) {
    const map::Keyframe* keyframe = map.keyframes().Find(KeyframeId(id));
    if (keyframe == nullptr) return std::nullopt;
    listing.rows.push_back(RowOf(map, *keyframe));
    return listing;
  }
  if (kind == Kind::kPoints) {
    const map::MapPoint* point = map.points().Find(PointId(id));
    if (point == nullptr) return std::nullopt;
    listing.rows.push_back(RowOf(map, *point));
    return listing;
  }
  for (Row& row : RowsOf(map, kind)) {
    if (row[0].whole == static_cast<std::int64_t>(id)) listing.rows.push_back(std::move(row));
  }
  return listing.rows.empty() ? std::nullopt : std::optional(std::move(listing));
}

std::string CellText(const Column& column, const Cell& cell) {
  switch (cell.kind) {
    case Cell::Kind::kNothing:
      return "";
    case Cell::Kind::kWhole:
      return absl::StrCat(cell.whole);
    case Cell::Kind::kReal:
      return absl::StrFormat("%.*f", column.decimals, cell.real);
    case Cell::Kind::kFlag:
      return cell.whole != 0 ? "yes" : "no";
    case Cell::Kind::kText:
      return cell.text;
  }
  return "";
}

}  // namespace cairn::inspect
