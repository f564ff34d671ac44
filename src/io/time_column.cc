#include "io/time_column.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "io/text_lines.h"

namespace cairn::io {
namespace {

constexpr std::array<TimeUnit, 4> kUnits = {TimeUnit::kSeconds, TimeUnit::kMilliseconds, TimeUnit::kMicroseconds,
                                            TimeUnit::kNanoseconds};
// A stream of images or poses has between 0.5 and 500 of them a second; the units are a factor of 1000 apart, so that
// no step fits two of them.
constexpr double kShortestStep_s = 0.002, kLongestStep_s = 2.0;
constexpr double kRateTolerance = 1.5;  // between the rate of a camera file and that of the times

double SecondsOf(TimeUnit unit) { return std::pow(1e-3, static_cast<int>(unit)); }

bool IsWhole(absl::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), absl::ascii_isdigit);
}

struct Numbers {
  std::vector<double> values;
  bool whole = true;     // no text has a point
  double step = 0.0;     // median of the differences; 0: fewer than two times
  double typical = 0.0;  // median
  bool by_one = false;   // whole numbers, each by one more than the one before
};

double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

absl::StatusOr<Numbers> Look(const std::string& path, const std::vector<TimeText>& texts, TimeUnit usual) {
  Numbers out;
  std::vector<double> steps;
  for (const TimeText& time : texts) {
    double value;
    if (!absl::SimpleAtod(time.text, &value) || !std::isfinite(value)) {
      return LineError(path, time.line, absl::StrCat("\"", time.text, "\" is not a time in ", TimeUnitName(usual)));
    }
    if (!out.values.empty()) steps.push_back(std::abs(value - out.values.back()));
    out.values.push_back(value);
    out.whole = out.whole && IsWhole(time.text);
  }
  out.by_one =
      out.whole && steps.size() > 1 && std::all_of(steps.begin(), steps.end(), [](double s) { return s == 1; });
  out.step = Median(steps);
  out.typical = Median(out.values);
  return out;
}

// The unit in which the times count from 1970, for the years 1980 to 2100: large numbers, near each other. Half of them
// must be: a broken line is no other unit.
std::optional<TimeUnit> UnitByEpoch(const Numbers& numbers) {
  const auto near = std::ranges::count_if(numbers.values, [&](double value) {
    return std::abs(value - numbers.typical) < 0.05 * std::abs(numbers.typical);
  });
  if (near * 2 < std::ssize(numbers.values)) return std::nullopt;
  for (const TimeUnit unit : kUnits) {
    const double seconds = numbers.typical * SecondsOf(unit);
    if (seconds > 3.15e8 && seconds < 4.1e9) return unit;
  }
  return std::nullopt;
}

std::optional<TimeUnit> UnitByStep(double step) {
  for (const TimeUnit unit : kUnits) {
    const double seconds = step * SecondsOf(unit);
    if (seconds >= kShortestStep_s && seconds < kLongestStep_s) return unit;
  }
  return std::nullopt;
}

// Those in which the times come at the rate of the camera.
std::vector<TimeUnit> UnitsByRate(const Numbers& numbers, double rate_hz) {
  std::vector<TimeUnit> fitting;
  if (numbers.step <= 0.0 || rate_hz <= 0.0) return fitting;
  for (const TimeUnit unit : kUnits) {
    const double ratio = rate_hz * numbers.step * SecondsOf(unit);
    if (ratio < kRateTolerance && ratio > 1.0 / kRateTolerance) fitting.push_back(unit);
  }
  if (numbers.by_one && fitting.empty()) fitting.push_back(TimeUnit::kFrames);
  return fitting;
}

std::string StepText(double step, TimeUnit unit) {
  const double seconds = step * SecondsOf(unit);
  return absl::StrFormat("%.4g s apart (%.3g Hz)", seconds, seconds > 0.0 ? 1.0 / seconds : 0.0);
}

absl::Status Ambiguous(const std::string& path, const Numbers& numbers, const TimeColumnRules& rules) {
  const std::string what = rules.of_images ? "images" : "poses";
  std::string other;
  if (const auto unit = UnitByStep(numbers.step); unit && *unit != rules.usual) {
    other = absl::StrCat(", in ", TimeUnitName(*unit), " ", StepText(numbers.step, *unit));
  }
  if (numbers.whole && rules.of_images) absl::StrAppend(&other, ", or frame numbers");
  const std::string rate =
      rules.rate_hz > 0.0 ? absl::StrFormat("; the camera file says %g Hz", rules.rate_hz) : std::string();
  const std::string fix_by_rate =
      rules.of_images && rules.rate_hz <= 0.0 ? ", or the true `rate_hz: 30`, say, to the camera file" : "";
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": the unit of the times is not clear: in ", TimeUnitName(rules.usual), " the ", what, " would be ",
      StepText(numbers.step, rules.usual), other, rate, "; add a first line that names it, `", rules.example,
      "`, say (s, ms, us, ns", rules.of_images ? ", frame" : "", ")", fix_by_rate));
}

struct Choice {
  TimeUnit unit;
  std::string why;
};

absl::StatusOr<Choice> ChooseNamed(const std::string& path, const Numbers& numbers, TimeUnit named) {
  const std::optional<TimeUnit> epoch = UnitByEpoch(numbers);
  if (named != TimeUnit::kFrames && epoch && *epoch != named && UnitByStep(numbers.step) == epoch) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": the header says that the times are ", TimeUnitName(named),
                                                   ", but they are ", TimeUnitName(*epoch), " since 1970, ",
                                                   StepText(numbers.step, *epoch), ": correct the header"));
  }
  return Choice{named, "as its header says"};
}

absl::StatusOr<Choice> Choose(const std::string& path, const Numbers& numbers, const TimeColumnRules& rules) {
  // What has a point counts nothing: "frames left out", say, is a remark.
  if (rules.named && (*rules.named != TimeUnit::kFrames || numbers.whole)) {
    return ChooseNamed(path, numbers, *rules.named);
  }
  const std::optional<TimeUnit> epoch = UnitByEpoch(numbers), step = UnitByStep(numbers.step);
  // Whole numbers one apart are seconds by a clock that knows no fractions, or count the frames.
  const bool counts = numbers.by_one && rules.usual == TimeUnit::kSeconds && !epoch && rules.of_images;
  if (!counts && (step == rules.usual || epoch == rules.usual || numbers.step <= 0.0)) {
    const bool other_by_size = numbers.step <= 0.0 && epoch && *epoch != rules.usual;
    return Choice{other_by_size ? *epoch : rules.usual, "as many since 1970"};
  }
  if (epoch && epoch == step) return Choice{*epoch, "since 1970"};
  const std::vector<TimeUnit> by_rate = UnitsByRate(numbers, rules.rate_hz);
  if (by_rate.size() == 1) return Choice{by_rate[0], absl::StrFormat("by the %g Hz of the camera file", rules.rate_hz)};
  if (by_rate.empty() && !counts && !numbers.whole && rules.rate_hz <= 0.0 && !rules.of_images) {
    return Choice{rules.usual, ""};  // poses may be far apart
  }
  // Nobody waits for months from one image to the next.
  if (numbers.whole && step == TimeUnit::kNanoseconds) return Choice{*step, "by their step"};
  if (!rules.of_images && numbers.by_one) return Choice{rules.usual, ""};
  return Ambiguous(path, numbers, rules);
}

std::string NoteOn(const Numbers& numbers, const TimeColumnRules& rules, const Choice& choice) {
  if (choice.unit == TimeUnit::kFrames) {
    return absl::StrFormat("the times are frame numbers: divided by the %g Hz of the camera file", rules.rate_hz);
  }
  if (choice.unit != rules.usual) {
    return absl::StrCat("the times are ", TimeUnitName(choice.unit), ", ", choice.why);
  }
  if (numbers.step <= 0.0) return "";
  const double step_s = numbers.step * SecondsOf(choice.unit);
  if (rules.of_images && rules.rate_hz > 0.0) {
    const double ratio = rules.rate_hz * step_s;
    if (ratio > kRateTolerance || ratio < 1.0 / kRateTolerance) {
      return absl::StrFormat("the times are %s, but the camera file says %g Hz; the times are used",
                             StepText(numbers.step, choice.unit), rules.rate_hz);
    }
  } else if (step_s >= kLongestStep_s && (rules.of_images || !numbers.whole)) {
    return absl::StrCat("the times were read as ", TimeUnitName(choice.unit), ", ", StepText(numbers.step, choice.unit),
                        "; `", rules.example, "` as a first line would say another unit");
  }
  if (!rules.of_images && numbers.by_one) {
    return "the times are whole numbers one apart, read as seconds: if they count frames, only files that count alike "
           "can be compared";
  }
  return "";
}

const std::set<std::string>& WordsOf(TimeUnit unit) {
  static const std::set<std::string> words[] = {{"s", "sec", "secs", "second", "seconds"},
                                                {"ms", "msec", "msecs", "millis", "millisecond", "milliseconds"},
                                                {"us", "usec", "usecs", "micros", "microsecond", "microseconds"},
                                                {"ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"},
                                                {"frame", "frames", "index", "idx"}};
  return words[static_cast<int>(unit)];
}

std::vector<std::string> Words(absl::string_view name) {
  std::string lower = absl::AsciiStrToLower(name);
  for (char& c : lower) {
    if (!absl::ascii_isalnum(static_cast<unsigned char>(c))) c = ' ';
  }
  return absl::StrSplit(lower, ' ', absl::SkipEmpty());
}

}  // namespace

std::optional<TimeUnit> UnitOfColumn(absl::string_view name) {
  for (const std::string& word : Words(name)) {
    for (const TimeUnit unit : {TimeUnit::kSeconds, TimeUnit::kMilliseconds, TimeUnit::kMicroseconds,
                                TimeUnit::kNanoseconds, TimeUnit::kFrames}) {
      if (WordsOf(unit).contains(word)) return unit;
    }
  }
  return std::nullopt;
}

bool NamesTime(absl::string_view name) {
  static const std::set<std::string> times = {"t", "ts", "time", "times", "timestamp", "timestamps", "stamp", "stamps"};
  const std::vector<std::string> words = Words(name);
  return UnitOfColumn(name).has_value() ||
         std::any_of(words.begin(), words.end(), [](const std::string& word) { return times.contains(word); });
}

absl::StatusOr<TimeColumn> ReadTimeColumn(const std::string& path, const std::vector<TimeText>& texts,
                                          const TimeColumnRules& rules) {
  CAIRN_ASSIGN_OR_RETURN(const Numbers numbers, Look(path, texts, rules.named.value_or(rules.usual)));
  CAIRN_ASSIGN_OR_RETURN(const Choice choice, Choose(path, numbers, rules));
  TimeColumn out;
  out.unit = choice.unit;
  if (choice.unit == TimeUnit::kFrames && rules.rate_hz <= 0.0) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        ": the times are frame numbers; add `rate_hz: 30`, say, to the camera file: how many there are a second"));
  }
  const bool since_1970 = UnitByEpoch(numbers) == choice.unit;
  for (std::size_t i = 0; i < texts.size(); ++i) {
    if (choice.unit == TimeUnit::kFrames) {
      out.times_ns.push_back(static_cast<TimeNs>(std::llround(numbers.values[i] * 1e9 / rules.rate_hz)));
      continue;
    }
    const absl::StatusOr<TimeNs> time_ns = ParseTime(texts[i].text, choice.unit);
    if (!time_ns.ok()) return LineError(path, texts[i].line, time_ns.status().message());
    if (since_1970 && std::abs(numbers.values[i]) < 0.1 * std::abs(numbers.typical)) {
      return LineError(path, texts[i].line,
                       absl::StrCat("\"", texts[i].text, "\" is not a time in ", TimeUnitName(choice.unit),
                                    " since 1970, as the others are"));
    }
    out.times_ns.push_back(*time_ns);
  }
  out.counts = numbers.by_one && choice.unit == TimeUnit::kSeconds && !since_1970;
  out.note = NoteOn(numbers, rules, choice);
  if (!out.note.empty()) out.note = absl::StrCat(path, ": ", out.note);
  return out;
}

}  // namespace cairn::io
