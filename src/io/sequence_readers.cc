#include "io/sequence_readers.h"

#include <algorithm>
#include <array>

#include "absl/strings/ascii.h"
#include "io/image_series.h"
#include "io/text_lines.h"
#include "io/time_column.h"

namespace cairn::io {

namespace fs = std::filesystem;

bool IsFile(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

bool IsFolder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored);
}

absl::StatusOr<CameraFile> GivenCamera(const fs::path& folder, const OpenOptions& options) {
  if (!options.camera_path.empty()) return LoadCamera(options.camera_path);
  const fs::path own = folder / "camera.yaml";
  if (IsFile(own)) return LoadCamera(own.string());
  return absl::NotFoundError(absl::StrCat("no calibration for ", folder.string(),
                                          ": there is no camera.yaml in it and none was given",
                                          " (--camera FILE); docs/input.md describes the file"));
}

namespace {

// How the name in a list becomes that of a file: as it stands; without quotes; with the slashes of this system; the
// first of several columns; without the folders of the machine where the list was made.
class NameReader {
 public:
  NameReader(const fs::path& folder, const std::string& list) : folder_(folder), list_(list) {}

  std::string PathOf(absl::string_view text) {
    const std::string plain = (folder_ / std::string(text)).string();
    if (IsFile(plain)) return plain;
    if (const std::optional<std::string> found = Find(text)) return *found;
    return plain;
  }
  // Of the first name that had to be read in another way; empty: none.
  const std::string& note() const { return note_; }

 private:
  std::optional<std::string> Find(absl::string_view text) {
    std::vector<std::string> names = {std::string(text)};
    if (const absl::string_view first = SplitFields(text)[0]; first != text) names.emplace_back(first);
    for (std::string name : names) {
      std::replace(name.begin(), name.end(), '\\', '/');
      for (;;) {
        const std::string path = (folder_ / name).string();
        if (IsFile(path)) {
          if (note_.empty()) note_ = absl::StrCat(list_, ": the file that it calls ", text, " is taken to be ", name);
          return path;
        }
        const std::size_t slash = name.find('/');
        if (slash == std::string::npos) break;
        name = name.substr(slash + 1);
      }
    }
    return std::nullopt;
  }

  fs::path folder_;
  std::string list_;
  std::string note_;
};

// The time and the rest of a line, by the separator of the file.
std::pair<absl::string_view, absl::string_view> SplitOff(absl::string_view text) {
  const absl::string_view time = SplitFields(text)[0];
  std::size_t end = static_cast<std::size_t>(time.data() + time.size() - text.data());
  if (time.empty() || end > text.size()) return {time, ""};
  end = std::min(text.find_first_not_of("\"'", end), text.size());
  const std::size_t begin = text.find_first_not_of(" \t,;", end);
  return {time, begin == absl::string_view::npos ? "" : text.substr(begin)};
}

}  // namespace

absl::Status ReadTimedList(const fs::path& list, SequenceFiles* out) {
  CAIRN_ASSIGN_OR_RETURN(const TextTable table, ReadTable(list.string()));
  if (table.lines.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(list.string(), " lists no images; expected lines of `seconds filename`"));
  }
  NameReader names(list.parent_path(), list.string());
  std::vector<TimeText> texts;
  std::vector<std::string> paths;
  for (const TextLine& line : table.lines) {
    const auto [time, name] = SplitOff(line.text);
    if (name.empty()) {
      return LineError(list.string(), line.number, "no file name; expected lines of `seconds filename`");
    }
    texts.push_back({line.number, time});
    paths.push_back(names.PathOf(name));
  }
  TimeColumnRules rules;
  rules.rate_hz = out->rate_hz;
  const std::vector<std::string> columns = ColumnNames(table.header);
  if (!columns.empty() && NamesTime(columns[0])) rules.named = UnitOfColumn(columns[0]);
  CAIRN_ASSIGN_OR_RETURN(const TimeColumn times, ReadTimeColumn(list.string(), texts, rules));
  TimeOrder order;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    CAIRN_RETURN_IF_ERROR(order.Add(times.times_ns[i], list.string(), texts[i].line));
    out->images.push_back({times.times_ns[i], paths[i], 0.0});
  }
  for (const std::string& note : {times.note, names.note()}) {
    if (!note.empty()) out->notes.push_back(note);
  }
  return absl::OkStatus();
}

int ChooseCamera(const OpenOptions& options, const std::function<bool(int)>& there_is) {
  if (options.camera_index >= 0) return options.camera_index;
  for (int i = 0; i < kMaxCameras; ++i) {
    if (there_is(i)) return i;
  }
  return 0;
}

std::vector<std::string> ImageNamesIn(const fs::path& folder) {
  static constexpr std::array<absl::string_view, 9> kExtensions = {".png", ".jpg", ".jpeg", ".bmp", ".pgm",
                                                                   ".ppm", ".tif", ".tiff", ".webp"};
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    const std::string extension = absl::AsciiStrToLower(it->path().extension().string());
    if (name[0] != '.' && std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end()) {
      names.push_back(name);
    }
  }
  std::sort(names.begin(), names.end(), NaturalLess);
  return names;
}

}  // namespace cairn::io
