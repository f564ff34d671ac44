#include "image/view_survey.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace cairn::image {
namespace {

constexpr int kSurveyWidth_px = 320;  // images are looked at no larger than this

double Percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

cv::Mat Small(const cv::Mat& image) {
  cv::Mat small;
  const double scale = std::min(1.0, static_cast<double>(kSurveyWidth_px) / std::max(image.cols, image.rows));
  cv::resize(image, small, {}, scale, scale, cv::INTER_AREA);
  small.convertTo(small, CV_32F);
  return small;
}

cv::Mat Root(const cv::Mat& squares, int window_px) {
  cv::Mat mean;
  cv::boxFilter(squares, mean, CV_32F, {window_px, window_px});
  cv::sqrt(cv::max(mean, 0.0), mean);
  return mean;
}

// What stays where the samples' mean keeps its contrast while the samples do not differ. Contrast is local: light that
// changes changes nothing. Nothing is fixed if hardly anything moves, as with a camera that stands.
cv::Mat FixedParts(const std::vector<cv::Mat>& samples) {
  cv::Mat sum = cv::Mat::zeros(samples[0].size(), CV_32F), squares = sum.clone();
  for (const cv::Mat& sample : samples) {
    sum += sample;
    squares += sample.mul(sample);
  }
  const double n = static_cast<double>(samples.size());
  const cv::Mat mean = sum / n, variance = squares / n - mean.mul(mean);
  constexpr int kWindow_px = 5;
  const cv::Mat stays = Root(mean.mul(mean), kWindow_px), changes = Root(variance, kWindow_px);
  constexpr double kContrast = 2.0, kRatio = 1.5;  // gray values; what stays against what changes
  cv::Mat fixed = (stays > kContrast) & (stays > kRatio * changes);
  const cv::Mat moving = (changes > kContrast) & (changes > kRatio * stays);
  constexpr double kMovingShare = 0.4;  // of all that has contrast
  const int num_moving = cv::countNonZero(moving), num_fixed = cv::countNonZero(fixed);
  if (num_moving < kMovingShare * (num_moving + num_fixed)) return {};
  // Smooth parts between edges that stay belong to them; single pixels are chance.
  const cv::Mat near = cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9});
  const cv::Mat spot = cv::getStructuringElement(cv::MORPH_ELLIPSE, {5, 5});
  cv::Mat padded;
  cv::copyMakeBorder(fixed, padded, 16, 16, 16, 16, cv::BORDER_REPLICATE);
  cv::morphologyEx(padded, padded, cv::MORPH_CLOSE, near);
  cv::morphologyEx(padded, padded, cv::MORPH_OPEN, spot);
  fixed = padded(cv::Rect({16, 16}, fixed.size())).clone();
  cv::Mat labels, stats, centroids;
  const int parts = cv::connectedComponentsWithStats(fixed, labels, stats, centroids);
  constexpr double kLeastPart = 0.01;  // of the view
  for (int part = 1; part < parts; ++part) {
    if (stats.at<int>(part, cv::CC_STAT_AREA) < kLeastPart * static_cast<double>(fixed.total())) {
      fixed.setTo(0, labels == part);
    }
  }
  cv::dilate(fixed, fixed, cv::getStructuringElement(cv::MORPH_ELLIPSE, {7, 7}));
  return fixed;
}

}  // namespace

double CombStrength(const cv::Mat& image) {
  if (image.rows < 8) return 0.0;
  cv::Mat gray;
  image.convertTo(gray, CV_32F);
  const auto rows = [&](int offset) { return gray.rowRange(2 + offset, gray.rows - 2 + offset); };
  const double across = cv::norm(rows(0) - 0.5 * (rows(-1) + rows(1)), cv::NORM_L1);
  const double within = cv::norm(rows(0) - 0.5 * (rows(-2) + rows(2)), cv::NORM_L1);
  return within > 0.0 ? across / within : 0.0;
}

namespace {

constexpr int kBandColumns = 8;
constexpr double kDark = 8.0;  // gray values; what is darker shows no bands

// Logarithm of the brightness of each row in each of some columns.
cv::Mat LogRows(const cv::Mat& image) {
  cv::Mat rows;
  image.convertTo(rows, CV_32F, 1.0, kDark);
  cv::resize(rows, rows, {kBandColumns, image.rows}, 0, 0, cv::INTER_AREA);
  cv::log(rows, rows);
  return rows;
}

// Per row the median over the columns: what moves, or is bright, is not in all of them.
std::vector<double> RowMedians(const cv::Mat& columns) {
  std::vector<double> medians;
  for (int y = 0; y < columns.rows; ++y) {
    const auto* row = columns.ptr<float>(y);
    medians.push_back(Percentile(std::vector<double>(row, row + columns.cols), 0.5));
  }
  return medians;
}

void TakeOutMeanAndSlope(std::vector<double>* signal) {
  const double n = static_cast<double>(signal->size());
  double mean = 0.0, slope = 0.0, weight = 0.0;
  for (const double s : *signal) mean += s / n;
  for (std::size_t y = 0; y < signal->size(); ++y) {
    const double at = static_cast<double>(y) - 0.5 * (n - 1.0);
    slope += at * (*signal)[y], weight += at * at;
  }
  for (std::size_t y = 0; y < signal->size(); ++y) {
    (*signal)[y] -= mean + slope / weight * (static_cast<double>(y) - 0.5 * (n - 1.0));
  }
}

struct Wave {
  double in = 0.0, out = 0.0;  // amplitudes of cosine and sine
  double Amplitude() const { return std::hypot(in, out); }
};

double PhaseAt(double periods, std::size_t row, std::size_t rows) {
  return 2.0 * std::numbers::pi * periods * static_cast<double>(row) / static_cast<double>(rows);
}

Wave WaveIn(const std::vector<double>& signal, double periods) {
  Wave wave;
  for (std::size_t y = 0; y < signal.size(); ++y) {
    const double phase = PhaseAt(periods, y, signal.size());
    wave.in += signal[y] * std::cos(phase), wave.out += signal[y] * std::sin(phase);
  }
  const double scale = 2.0 / static_cast<double>(signal.size());
  return {wave.in * scale, wave.out * scale};
}

Bands LargestWave(const std::vector<double>& signal, double from, double to, double step) {
  Bands best;
  for (double periods = from; periods <= to; periods += step) {
    const double amplitude = WaveIn(signal, periods).Amplitude();
    if (amplitude > best.amplitude) best = {amplitude, periods};
  }
  return best;
}

}  // namespace

Bands BandsBetween(const cv::Mat& image, const cv::Mat& next) {
  if (image.size() != next.size() || image.rows < 32 || image.cols < kBandColumns * 4) return {};
  std::vector<double> signal = RowMedians(LogRows(next) - LogRows(image));
  TakeOutMeanAndSlope(&signal);
  double power = 0.0;
  for (const double s : signal) power += s * s;
  Bands best = LargestWave(signal, 0.75, 12.0, 0.25);
  best = LargestWave(signal, best.periods - 0.25, best.periods + 0.25, 0.01);
  constexpr double kExplained = 0.5;  // of the power, by one wave
  const double explained = 0.5 * static_cast<double>(signal.size()) * best.amplitude * best.amplitude;
  return power > 0.0 && explained > kExplained * power ? best : Bands();
}

void EvenOutBands(double periods, cv::Mat* image) {
  if (image->cols < kBandColumns || image->rows < 4) return;
  std::vector<double> rows = RowMedians(LogRows(*image));
  TakeOutMeanAndSlope(&rows);
  const Wave first = WaveIn(rows, periods), second = WaveIn(rows, 2.0 * periods);
  for (int y = 0; y < image->rows; ++y) {
    const double phase = PhaseAt(periods, static_cast<std::size_t>(y), rows.size());
    const double log_gain = first.in * std::cos(phase) + first.out * std::sin(phase) +
                            second.in * std::cos(2.0 * phase) + second.out * std::sin(2.0 * phase);
    const double gain = std::exp(-log_gain);
    cv::Mat row = image->row(y);
    row.convertTo(row, CV_8U, gain, kDark * (gain - 1.0));
  }
}

void ViewSurveyor::Add(const cv::Mat& image, const cv::Mat& next) {
  if (image.empty() || (!size_.empty() && image.size() != size_)) return;
  size_ = image.size();
  const cv::Mat small = Small(image);
  cv::Mat around;
  cv::blur(small, around, {9, 9});
  small_.push_back(small - around);
  combs_.push_back(CombStrength(image));
  if (!next.empty()) bands_.push_back(BandsBetween(image, next));
}

ViewSurvey ViewSurveyor::Result() const {
  ViewSurvey survey;
  constexpr int kLeastSamples = 12;
  if (count() < kLeastSamples) return survey;
  // A camera that stands now and then makes no comb, and bands that stand still are not seen.
  constexpr double kComb = 1.1, kLeastBands = 0.03;
  survey.interlaced = Percentile(combs_, 0.7) > kComb;
  std::vector<double> amplitudes, periods;
  for (const Bands& bands : bands_) {
    amplitudes.push_back(bands.amplitude);
    if (bands.amplitude > kLeastBands) periods.push_back(bands.periods);
  }
  const double amplitude = Percentile(std::move(amplitudes), 0.4);
  if (amplitude > kLeastBands) survey.bands = {amplitude, Percentile(std::move(periods), 0.5)};
  const cv::Mat fixed = FixedParts(small_);
  if (fixed.empty() || cv::countNonZero(fixed) == 0) return survey;
  survey.fixed_share = static_cast<double>(cv::countNonZero(fixed)) / static_cast<double>(fixed.total());
  cv::resize(fixed, survey.mask, size_, 0, 0, cv::INTER_NEAREST);
  cv::bitwise_not(survey.mask, survey.mask);
  return survey;
}

void DropSecondField(cv::Mat* image) {
  for (int y = 1; y < image->rows; y += 2) {
    const auto* above = image->ptr<std::uint8_t>(y - 1);
    const auto* below = y + 1 < image->rows ? image->ptr<std::uint8_t>(y + 1) : above;
    auto* row = image->ptr<std::uint8_t>(y);
    for (int x = 0; x < image->cols; ++x) row[x] = static_cast<std::uint8_t>((above[x] + below[x] + 1) / 2);
  }
}

MaskFiller::MaskFiller(const cv::Mat& mask) {
  const cv::Rect hidden = cv::boundingRect(mask == 0);
  if (hidden.empty()) return;
  mask_ = mask;
  constexpr int kMargin_px = 64;
  around_ = (hidden - cv::Point(kMargin_px, kMargin_px) + cv::Size(2 * kMargin_px, 2 * kMargin_px)) &
            cv::Rect({0, 0}, mask.size());
}

// Weighted means over ever larger windows, each filling what the smaller ones left open.
void MaskFiller::Fill(cv::Mat* image) const {
  if (mask_.empty() || image->size() != mask_.size()) return;
  cv::Mat part = (*image)(around_);
  const cv::Mat hidden = mask_(around_) == 0;
  cv::Mat weight, value;
  mask_(around_).convertTo(weight, CV_32F, 1.0 / 255.0);
  cv::threshold(weight, weight, 0.0, 1.0, cv::THRESH_BINARY);
  part.convertTo(value, CV_32F);
  value = value.mul(weight);
  std::vector<cv::Mat> weights = {weight}, values = {value};
  while (std::min(weights.back().cols, weights.back().rows) > 2) {
    cv::Mat w, v;
    cv::pyrDown(weights.back(), w);
    cv::pyrDown(values.back(), v);
    weights.push_back(w), values.push_back(v);
  }
  cv::Mat filled = values.back() / cv::max(weights.back(), 1e-6f);
  for (std::size_t level = weights.size() - 1; level-- > 0;) {
    cv::Mat up;
    cv::pyrUp(filled, up, weights[level].size());
    const cv::Mat known = cv::min(weights[level], 1.0f);
    const cv::Mat own = values[level] / cv::max(weights[level], 1e-6f);
    filled = own.mul(known) + up.mul(1.0f - known);
  }
  cv::Mat bytes;
  filled.convertTo(bytes, CV_8U);
  bytes.copyTo(part, hidden);
}

}  // namespace cairn::image
