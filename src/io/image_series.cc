#include "io/image_series.h"

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "io/atomic_file.h"
#include "io/image_codecs.h"
#include "io/sequence_readers.h"

namespace cairn::io {
namespace {

namespace fs = std::filesystem;

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

// A name in parts: text and numbers in turn. A point between digits belongs to the number: times have one.
struct Part {
  bool number = false;
  absl::string_view text;
};

std::vector<Part> PartsOf(absl::string_view name) {
  std::vector<Part> parts;
  for (std::size_t at = 0; at < name.size();) {
    const bool number = IsDigit(name[at]);
    std::size_t end = at;
    while (end < name.size() && (IsDigit(name[end]) == number ||
                                 (number && name[end] == '.' && end + 1 < name.size() && IsDigit(name[end + 1])))) {
      ++end;
    }
    parts.push_back({number, name.substr(at, end - at)});
    at = end;
  }
  return parts;
}

int CompareDigits(absl::string_view a, absl::string_view b) {
  a.remove_prefix(std::min(a.find_first_not_of('0'), a.size()));
  b.remove_prefix(std::min(b.find_first_not_of('0'), b.size()));
  if (a.size() != b.size()) return a.size() < b.size() ? -1 : 1;
  return a.compare(b);
}

// Digits with points between them, each run by its value.
int CompareNumbers(absl::string_view a, absl::string_view b) {
  const std::vector<absl::string_view> left = absl::StrSplit(a, '.'), right = absl::StrSplit(b, '.');
  for (std::size_t i = 0; i < std::min(left.size(), right.size()); ++i) {
    if (const int order = CompareDigits(left[i], right[i]); order != 0) return order;
  }
  return static_cast<int>(left.size()) - static_cast<int>(right.size());
}

std::string ExtensionOf(absl::string_view name) {
  std::string extension = absl::AsciiStrToLower(fs::path(std::string(name)).extension().string());
  if (extension == ".jpeg") return ".jpg";
  return extension == ".tiff" ? ".tif" : extension;
}

// The name with # for each number, without its extension: what the images of a series have in common.
std::string FormOf(absl::string_view name) {
  std::string form;
  const std::string stem = fs::path(std::string(name)).stem().string();
  for (const Part& part : PartsOf(stem)) {
    absl::StrAppend(&form, part.number ? "#" : part.text);
  }
  return form;
}

std::vector<std::string> NumbersOf(absl::string_view name) {
  std::vector<std::string> numbers;
  const std::string stem = fs::path(std::string(name)).stem().string();
  for (const Part& part : PartsOf(stem)) {
    if (!part.number) continue;
    absl::string_view digits = part.text;
    digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size() - 1));
    numbers.emplace_back(digits);
  }
  return numbers;
}

using Names = std::vector<std::string>;

// How many of the smaller set are in both, as a share.
double Common(const std::set<std::string>& a, const std::set<std::string>& b) {
  std::vector<std::string> both;
  std::ranges::set_intersection(a, b, std::back_inserter(both));
  return static_cast<double>(both.size()) / static_cast<double>(std::max<std::size_t>(std::min(a.size(), b.size()), 1));
}

// Several cameras under names of one form: cam0_0001, cam1_0001. The numbers of one place, all but it being the same.
std::vector<Names> SplitByCamera(const Names& names) {
  constexpr std::size_t kMostCameras = 8;
  const std::size_t places = NumbersOf(names[0]).size();
  for (std::size_t place = 0; places > 1 && place < places; ++place) {
    std::map<std::string, Names> by_number;
    std::map<std::string, std::set<std::string>> others;
    for (const std::string& name : names) {
      std::vector<std::string> numbers = NumbersOf(name);
      const std::string number = numbers[place];
      numbers.erase(numbers.begin() + static_cast<std::ptrdiff_t>(place));
      by_number[number].push_back(name);
      others[number].insert(absl::StrJoin(numbers, " "));
      if (by_number.size() > kMostCameras) break;
    }
    if (by_number.size() < 2 || by_number.size() > kMostCameras) continue;
    const std::set<std::string>& first = others.begin()->second;
    const bool same = first.size() > 1 && std::ranges::all_of(others, [&](const auto& other) {
                        return other.second.size() > 1 && Common(first, other.second) > 0.5;
                      });
    if (!same) continue;
    std::vector<Names> series;
    for (auto& [number, members] : by_number) series.push_back(std::move(members));
    return series;
  }
  return {names};
}

// Names of one form and extension. Files of another extension belong to them if they fill their gaps (a few jpg among
// png), and are a series of their own if they repeat their numbers (colour as jpg, depth as png).
std::vector<Names> SplitByForm(const Names& all) {
  std::map<std::string, std::map<std::string, Names>> by_form;
  for (const std::string& name : all) by_form[FormOf(name)][ExtensionOf(name)].push_back(name);
  std::vector<Names> series;
  for (const auto& [form, by_extension] : by_form) {
    std::set<std::string> stems;
    std::size_t count = 0;
    Names together;
    for (const auto& [extension, names] : by_extension) {
      for (const std::string& name : names) stems.insert(absl::StrJoin(NumbersOf(name), " "));
      count += names.size();
      together.insert(together.end(), names.begin(), names.end());
    }
    if (stems.size() == count || !absl::StrContains(form, '#')) {
      series.push_back(std::move(together));
    } else {
      for (const auto& [extension, names] : by_extension) series.push_back(names);
    }
  }
  std::vector<Names> result;
  for (const Names& names : series) {
    for (Names& one : SplitByCamera(names)) result.push_back(std::move(one));
  }
  for (Names& names : result) std::ranges::sort(names, NaturalLess);
  std::ranges::stable_sort(result, [](const Names& a, const Names& b) { return a.size() > b.size(); });
  return result;
}

bool HasWord(const std::string& name, std::initializer_list<absl::string_view> words) {
  std::string lower = absl::AsciiStrToLower(fs::path(name).stem().string());
  for (char& c : lower) {
    if (!absl::ascii_isalpha(static_cast<unsigned char>(c))) c = ' ';
  }
  const std::vector<absl::string_view> of_name = absl::StrSplit(lower, ' ', absl::SkipEmpty());
  return std::ranges::any_of(of_name, [&](absl::string_view word) { return std::ranges::count(words, word) > 0; });
}

bool SaysOther(const std::string& name) {
  return HasWord(name, {"depth",  "d",         "disp",         "disparity",  "mask",      "masks",    "label",
                        "labels", "seg",       "segmentation", "semantic",   "semantics", "instance", "instances",
                        "normal", "normals",   "conf",         "confidence", "flow",      "alpha",    "preview",
                        "thumb",  "thumbnail", "ir",           "infrared"});
}

bool SaysCamera(const std::string& name) {
  return HasWord(name, {"color", "colour", "rgb", "image", "img", "photo", "frame", "gray", "grey", "mono"});
}

struct Kind {
  bool deep = false;  // 16 bits
  cv::Size size;      // empty: not readable
};

Kind KindOf(const fs::path& folder, const Names& names) {
  for (std::size_t i = 0; i < std::min<std::size_t>(names.size(), 3); ++i) {
    const absl::StatusOr<std::string> bytes = ReadWholeFile((folder / names[i]).string());
    if (!bytes.ok()) continue;
    const absl::StatusOr<cv::Mat> image = DecodeGray(*bytes);
    if (image.ok()) return {image->depth() == CV_16U, image->size()};
  }
  return {};
}

std::string Describe(const Names& names) {
  if (names.size() == 1) return names[0];
  return absl::StrCat(names.front(), " to ", names.back(), " (", names.size(), " images)");
}

std::string DescribeAll(const std::vector<Names>& series) {
  constexpr std::size_t kMostTold = 4;
  std::vector<std::string> texts;
  for (const Names& names : series) {
    if (texts.size() < kMostTold) texts.push_back(Describe(names));
  }
  if (series.size() > kMostTold) texts.push_back(absl::StrCat(series.size() - kMostTold, " more"));
  return absl::StrJoin(texts, ", ");
}

// Moves what `keep` refuses to `others`, unless nothing would be left.
template <class Keep>
void Filter(const Keep& keep, std::vector<Names>* series, std::vector<Names>* others) {
  if (series->size() < 2 || !std::ranges::any_of(*series, keep)) return;
  std::ranges::copy_if(*series, std::back_inserter(*others), [&](const Names& names) { return !keep(names); });
  std::erase_if(*series, [&](const Names& names) { return !keep(names); });
}

// Whether the names have a form at all: not hashes, not words.
bool AreSeries(const std::vector<Names>& series, std::size_t count) {
  const bool numbered = absl::StrContains(FormOf(series[0][0]), '#');
  return numbered && (series.size() <= 8 || series[0].size() * 2 > count);
}

}  // namespace

bool NaturalLess(absl::string_view a, absl::string_view b) {
  const std::vector<Part> left = PartsOf(a), right = PartsOf(b);
  for (std::size_t i = 0; i < std::min(left.size(), right.size()); ++i) {
    const bool numbers = left[i].number && right[i].number;
    const int order = numbers ? CompareNumbers(left[i].text, right[i].text) : left[i].text.compare(right[i].text);
    if (order != 0) return order < 0;
  }
  if (left.size() != right.size()) return left.size() < right.size();
  return a < b;  // 1.png and 01.png
}

absl::StatusOr<ImageSeries> FindImageSeries(const fs::path& folder, cv::Size size) {
  ImageSeries out;
  out.names = ImageNamesIn(folder);
  if (out.names.empty()) return out;
  std::vector<Names> series = SplitByForm(out.names), others;
  if (series.size() > 1 && AreSeries(series, out.names.size())) {
    const std::size_t largest = series[0].size();
    Filter([&](const Names& names) { return names.size() > 3 || names.size() * 4 > largest; }, &series, &others);
    Filter([](const Names& names) { return !SaysOther(names[0]); }, &series, &others);
    if (series.size() > 1) {
      std::map<std::string, Kind> kinds;
      for (const Names& names : series) kinds[names[0]] = KindOf(folder, names);
      Filter([&](const Names& names) { return size.empty() || kinds[names[0]].size == size; }, &series, &others);
      Filter([&](const Names& names) { return !kinds[names[0]].deep; }, &series, &others);
      Filter([](const Names& names) { return SaysCamera(names[0]); }, &series, &others);
    }
    if (series.size() > 1) {
      return absl::InvalidArgumentError(absl::StrCat(
          folder.string(), " holds several series of images, of which any could be the camera's: ", DescribeAll(series),
          "; move each into a folder of its own, or list the images of one in times.txt (docs/input.md)"));
    }
    out.names = series[0];
    if (!others.empty()) {
      out.notes.push_back(absl::StrCat(folder.string(), ": ", Describe(out.names),
                                       " are the camera's; left out: ", DescribeAll(others)));
    }
  }
  if (!std::ranges::is_sorted(out.names)) {
    out.notes.push_back(absl::StrCat(folder.string(),
                                     ": the images are taken in the order of the numbers in their "
                                     "names: ",
                                     Describe(out.names)));
  }
  return out;
}

}  // namespace cairn::io
