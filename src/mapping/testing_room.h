// A room with textured walls, rendered by ray casting, and packets as the direct module would make them: for tests of
// the whole feature module on real images with known truth.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "base/random.h"
#include "direct/packet.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::mapping::testing {

inline const Pinhole kRoomPinhole{320, 240, 220.0, 220.0, 159.5, 119.5};

class Room {
 public:
  // Half the room's size, in metres; the origin is its middle.
  Vector3d half = {3.0, 1.6, 3.0};
  // Directions (atan2(x, z), radians) between which the walls have no texture; equal: none.
  double blank_from_rad = 0.0;
  double blank_to_rad = 0.0;
  std::uint64_t salt = 0;  // of the textures: another one is another room

  // Distance along a direction of the room until the wall.
  double Distance(const Vector3d& from, const Vector3d& direction) const {
    double nearest = 1e9;
    for (int axis = 0; axis < 3; ++axis) {
      if (direction[axis] == 0.0) continue;
      const double wall = direction[axis] > 0.0 ? half[axis] : -half[axis];
      nearest = std::min(nearest, (wall - from[axis]) / direction[axis]);
    }
    return nearest;
  }

  double Brightness(const Vector3d& point) const {
    const double heading = std::atan2(point.x(), point.z());
    if (heading > blank_from_rad && heading < blank_to_rad) return 128.0;
    int axis = 0;
    (half.cwiseAbs() - point.cwiseAbs()).minCoeff(&axis);
    const double u = point[(axis + 1) % 3], v = point[(axis + 2) % 3];
    const std::uint64_t wall = 20 * salt + static_cast<std::uint64_t>(axis * 2 + (point[axis] > 0.0 ? 1 : 0));
    return 40.0 + 90.0 * Cell(u, v, 0.31, wall) + 80.0 * Cell(u + 0.1, v, 0.11, wall + 10);
  }

  // 8-bit image of a camera, four rays per pixel.
  cv::Mat Render(const SE3& room_from_camera) const {
    cv::Mat image(kRoomPinhole.height_px, kRoomPinhole.width_px, CV_8UC1);
    const Vector3d& centre = room_from_camera.translation();
    const Matrix3d rotation = room_from_camera.RotationMatrix();
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        double sum = 0.0;
        for (const double dy : {-0.25, 0.25}) {
          for (const double dx : {-0.25, 0.25}) {
            const Vector3d ray = rotation * kRoomPinhole.Unproject({x + dx, y + dy});
            sum += Brightness(centre + Distance(centre, ray) * ray);
          }
        }
        image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(0.25 * sum);
      }
    }
    return image;
  }

 private:
  static double Cell(double u, double v, double size, std::uint64_t salt) {
    const auto i = static_cast<std::int64_t>(std::floor(u / size)), j = static_cast<std::int64_t>(std::floor(v / size));
    return Random(static_cast<std::uint64_t>(i * 73856093 + j * 19349663) ^ (salt << 48)).Uniform();
  }
};

// Circle round the room's middle, looking outwards: `turn` in turns.
inline SE3 CirclePose(double turn, double radius) {
  const double angle = 2.0 * 3.141592653589793 * turn;
  const Vector3d centre(radius * std::sin(angle), 0.1 * std::sin(3.0 * angle), radius * std::cos(angle));
  return {ExpSO3(Vector3d(0.0, angle, 0.0)), centre};
}

// Turns true poses and depths into those of a direct module whose unit of length wanders.
class PacketMaker {
 public:
  explicit PacketMaker(const Room& room, std::uint64_t seed = 1) : room_(room), random_(seed) {}

  double depth_noise = 0.01;       // relative
  double position_noise = 0.0005;  // per packet, direct units
  TimeNs period_ns = 200000000;

  // `scale`: metres per direct unit now.
  direct::KeyframePacket Make(const SE3& room_from_camera, double scale, std::int64_t segment = 0) {
    direct::KeyframePacket packet;
    packet.keyframe = count_;
    packet.segment = segment;
    packet.frame.index = 5 * count_;
    packet.frame.time_ns = count_ * period_ns;
    packet.frame.image = room_.Render(room_from_camera);
    packet.keyframe_rate_hz = 1e9 / static_cast<double>(period_ns);
    if (count_ > 0) {
      const SE3 motion = last_.Inverse() * room_from_camera;
      const Vector3d noise = position_noise * Vector3d(random_.Normal(), random_.Normal(), random_.Normal());
      direct_ = direct_ * SE3(motion.rotation(), motion.translation() / scale + noise);
    }
    packet.direct_from_camera = direct_;
    last_ = room_from_camera;
    ++count_;
    for (int y = 2; y < kRoomPinhole.height_px - 2; y += 4) {
      for (int x = 2; x < kRoomPinhole.width_px - 2; x += 4) {
        const Vector3d ray = room_from_camera.rotation() * kRoomPinhole.Unproject({double(x), double(y)});
        const double z = room_.Distance(room_from_camera.translation(), ray) / scale;
        const double inverse = (1.0 + depth_noise * random_.Normal()) / z;
        packet.points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(inverse),
                                 static_cast<float>(depth_noise * depth_noise * inverse * inverse)});
      }
    }
    return packet;
  }

 private:
  const Room& room_;
  Random random_;
  std::int64_t count_ = 0;
  SE3 last_, direct_;
};

}  // namespace cairn::mapping::testing
