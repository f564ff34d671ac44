#include "scenes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <system_error>

namespace cairn::train {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 640;
constexpr int kHeight = 480;

bool IsPicture(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg" || extension == ".webp";
}

// Empty if it is of no use.
Picture Load(const fs::path& path, int max_side_px) {
  Picture picture;
  cv::Mat image = cv::imread(path.string(), cv::IMREAD_UNCHANGED);
  if (image.empty() || image.depth() != CV_8U) return picture;
  const double scale = std::min(1.0, static_cast<double>(max_side_px) / std::max(image.cols, image.rows));
  if (scale < 1.0) cv::resize(image, image, {}, scale, scale, cv::INTER_AREA);
  if (std::min(image.cols, image.rows) < 48) return picture;
  cv::Mat gray;
  if (image.channels() == 4) {
    cv::extractChannel(image, picture.opacity, 3);
    cv::cvtColor(image, gray, cv::COLOR_BGRA2GRAY);
  } else if (image.channels() == 3) {
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  } else if (image.channels() == 1) {
    gray = image;
  } else {
    return picture;
  }
  cv::Scalar mean, deviation;
  cv::meanStdDev(gray, mean, deviation, picture.opacity);
  if (deviation[0] >= 4.0) picture.gray = gray;
  return picture;
}

const Picture& Pick(const std::vector<Picture>& pictures, Random* random) {
  return pictures[random->Below(pictures.size())];
}

using Quad = std::array<cv::Point2f, 4>;

// A rectangle around a centre, turned and seen in perspective.
Quad RandomQuad(cv::Point2f centre, double width, double height, double max_turn_rad, double perspective,
                Random* random) {
  const double turn = random->Uniform(-max_turn_rad, max_turn_rad);
  const double c = std::cos(turn), s = std::sin(turn);
  Quad quad;
  constexpr std::array<std::array<double, 2>, 4> kCorners = {{{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}};
  const double tilt_x = random->Uniform(-perspective, perspective), tilt_y = random->Uniform(-perspective, perspective);
  for (std::size_t i = 0; i < 4; ++i) {
    const double z = 1.0 + tilt_x * kCorners[i][0] + tilt_y * kCorners[i][1];
    const double x = kCorners[i][0] * width / z, y = kCorners[i][1] * height / z;
    quad[i] = centre + cv::Point2f(static_cast<float>(c * x - s * y), static_cast<float>(s * x + c * y));
  }
  return quad;
}

// Draws the picture onto the quad, with gain and offset of its light. Reduced first when drawn small, so that it does
// not alias.
void Paste(const Picture& picture, const Quad& quad, double gain, double offset, cv::Mat* canvas) {
  const double drawn = std::max(cv::norm(quad[1] - quad[0]), cv::norm(quad[2] - quad[3]));
  const double scale = std::min(1.0, std::max(drawn, 16.0) / picture.gray.cols);
  cv::Mat gray = picture.gray, opacity = picture.opacity;
  if (scale < 1.0) {
    cv::resize(gray, gray, {}, scale, scale, cv::INTER_AREA);
    if (!opacity.empty()) cv::resize(opacity, opacity, gray.size(), 0, 0, cv::INTER_AREA);
  }
  if (opacity.empty()) opacity = cv::Mat(gray.size(), CV_8UC1, cv::Scalar(255));
  const auto w = static_cast<float>(gray.cols), h = static_cast<float>(gray.rows);
  const cv::Rect area =
      cv::boundingRect(std::vector<cv::Point2f>(quad.begin(), quad.end())) & cv::Rect(0, 0, canvas->cols, canvas->rows);
  if (area.empty()) return;
  const cv::Point2f origin(static_cast<float>(area.x), static_cast<float>(area.y));
  const Quad source = {cv::Point2f(0, 0), cv::Point2f(w, 0), cv::Point2f(w, h), cv::Point2f(0, h)};
  const Quad target = {quad[0] - origin, quad[1] - origin, quad[2] - origin, quad[3] - origin};
  const cv::Mat warp = cv::getPerspectiveTransform(source.data(), target.data());
  cv::Mat warped, mask;
  cv::warpPerspective(gray, warped, warp, area.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::warpPerspective(opacity, mask, warp, area.size(), cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(0));
  for (int y = 0; y < area.height; ++y) {
    const std::uint8_t* from = warped.ptr(y);
    const std::uint8_t* alpha = mask.ptr(y);
    float* to = canvas->ptr<float>(area.y + y) + area.x;
    for (int x = 0; x < area.width; ++x) {
      const float a = static_cast<float>(alpha[x]) / 255.0f;
      to[x] += a * (static_cast<float>(gain * from[x] + offset) - to[x]);
    }
  }
}

// A surface without texture, shaded smoothly.
Picture PlainSurface(Random* random) {
  Picture picture;
  picture.gray.create(64, 64, CV_8UC1);
  const double level = random->Uniform(30, 220), dx = random->Uniform(-0.5, 0.5), dy = random->Uniform(-0.5, 0.5);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x)
      picture.gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(level + dx * x + dy * y);
  }
  return picture;
}

cv::Mat PhotographView(const Library& library, Random* random) {
  cv::Mat canvas(kHeight, kWidth, CV_32FC1, cv::Scalar(0));
  const Picture& photo = Pick(library.photographs, random);
  // At least the whole view is covered; up to the photograph's own resolution, so that it shows parts at many scales.
  const double aspect = static_cast<double>(photo.gray.cols) / photo.gray.rows;
  const double cover = 1.5 * std::max<double>(kHeight, kWidth / aspect);
  const double height = cover * std::exp(random->Uniform(0.0, std::log(std::max(1.1, 1.1 * photo.gray.rows / cover))));
  const double slack_x = std::max(0.0, 0.5 * (height * aspect / 1.5 - kWidth));
  const double slack_y = std::max(0.0, 0.5 * (height / 1.5 - kHeight));
  const cv::Point2f centre(static_cast<float>(0.5 * kWidth + random->Uniform(-slack_x, slack_x)),
                           static_cast<float>(0.5 * kHeight + random->Uniform(-slack_y, slack_y)));
  Picture upright = photo;
  upright.opacity = cv::Mat();
  Paste(upright, RandomQuad(centre, height * aspect, height, 0.35, 0.3, random), random->Uniform(0.6, 1.1),
        random->Uniform(-10, 30), &canvas);
  return canvas;
}

cv::Mat RoomView(const Library& library, Random* random) {
  cv::Mat canvas(kHeight, kWidth, CV_32FC1, cv::Scalar(random->Uniform(40, 200)));
  const auto anywhere = [&] {
    return cv::Point2f(static_cast<float>(random->Uniform(0, kWidth)), static_cast<float>(random->Uniform(0, kHeight)));
  };
  const auto surfaces = 3 + random->Below(6);
  for (std::uint64_t i = 0; i < surfaces; ++i) {
    const double size = std::exp(random->Uniform(std::log(150.0), std::log(800.0)));
    const Quad quad = RandomQuad(anywhere(), size * random->Uniform(0.6, 1.6), size, 0.3, 0.7, random);
    const Picture surface = random->Uniform() < 0.3 ? PlainSurface(random) : Pick(library.textures, random);
    Paste(surface, quad, random->Uniform(0.4, 1.2), random->Uniform(-10, 40), &canvas);
  }
  const auto things = 6 + random->Below(20);
  for (std::uint64_t i = 0; i < things; ++i) {
    const double kind = random->Uniform();
    const Picture& picture = kind < 0.6   ? Pick(library.objects, random)
                             : kind < 0.7 ? Pick(library.photographs, random)
                                          : Pick(library.textures, random);
    const double size = std::exp(random->Uniform(std::log(30.0), std::log(350.0)));
    const double aspect = static_cast<double>(picture.gray.cols) / picture.gray.rows;
    Paste(picture, RandomQuad(anywhere(), size * aspect, size, 0.35, 0.6, random), random->Uniform(0.5, 1.2),
          random->Uniform(-10, 30), &canvas);
  }
  return canvas;
}

}  // namespace

absl::StatusOr<std::vector<Picture>> LoadPictures(const std::string& folder, int max_side_px, std::size_t max_count) {
  std::vector<fs::path> paths;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (!it->is_symlink() && it->is_regular_file() && IsPicture(it->path())) paths.push_back(it->path());
  }
  if (error) return absl::NotFoundError(absl::StrCat("cannot read the folder ", folder, ": ", error.message()));
  std::sort(paths.begin(), paths.end());
  const std::size_t count = std::min(paths.size(), max_count);
  std::vector<Picture> pictures;
  for (std::size_t i = 0; i < count; ++i) {
    try {
      Picture picture = Load(paths[i * paths.size() / count], max_side_px);
      if (!picture.gray.empty()) pictures.push_back(std::move(picture));
    } catch (const cv::Exception&) {
      continue;  // a damaged picture: there are enough others
    }
  }
  if (pictures.empty()) return absl::NotFoundError(absl::StrCat("there are no usable pictures under ", folder));
  return pictures;
}

cv::Mat MakeView(const Library& library, Random* random) {
  cv::Mat canvas = random->Uniform() < 0.35 ? PhotographView(library, random) : RoomView(library, random);
  const double sigma = random->Uniform(0.4, 1.3);
  cv::GaussianBlur(canvas, canvas, {}, sigma);
  const double gamma = random->Uniform(0.7, 1.4), noise = random->Uniform(0.5, 4.0), gain = random->Uniform(0.7, 1.1);
  // The camera's response as a table of tenths of a grey value.
  std::array<double, 2551> response;
  for (std::size_t i = 0; i < response.size(); ++i) {
    response[i] = 255.0 * gain * std::pow(static_cast<double>(i) / 2550.0, gamma);
  }
  cv::Mat view(canvas.size(), CV_8UC1);
  for (int y = 0; y < view.rows; ++y) {
    for (int x = 0; x < view.cols; ++x) {
      const auto tenths = static_cast<std::size_t>(10.0f * std::clamp(canvas.at<float>(y, x), 0.0f, 255.0f));
      view.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(response[tenths] + noise * random->Normal());
    }
  }
  return view;
}

}  // namespace cairn::train
