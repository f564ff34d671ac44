#include "geometry/geodesy.h"

#include <cmath>
#include <numbers>

namespace cairn {
namespace {

constexpr double kSemiMajorAxis_m = 6378137.0;
constexpr double kFlattening = 1.0 / 298.257223563;
constexpr double kEccentricity2 = kFlattening * (2.0 - kFlattening);
constexpr double kRadPerDeg = std::numbers::pi / 180.0;

// Radius of curvature in the prime vertical.
double PrimeVerticalRadius(double sin_latitude) {
  return kSemiMajorAxis_m / std::sqrt(1.0 - kEccentricity2 * sin_latitude * sin_latitude);
}

}  // namespace

absl::Status GeoPosition::Validate() const {
  const auto bad = [](const char* what) {
    return absl::InvalidArgumentError(absl::StrCat("geographic position: ", what));
  };
  if (!(latitude_deg >= -90.0 && latitude_deg <= 90.0)) return bad("the latitude must be between -90 and 90 degrees");
  if (!(longitude_deg >= -180.0 && longitude_deg <= 180.0)) {
    return bad("the longitude must be between -180 and 180 degrees");
  }
  if (!(std::abs(height_m) <= 1e5)) return bad("the height must be within 100 km of the ellipsoid");
  return absl::OkStatus();
}

Vector3d EcefFromGeodetic(const GeoPosition& position) {
  const double latitude = position.latitude_deg * kRadPerDeg, longitude = position.longitude_deg * kRadPerDeg;
  const double radius = PrimeVerticalRadius(std::sin(latitude));
  const double across = (radius + position.height_m) * std::cos(latitude);
  return {across * std::cos(longitude), across * std::sin(longitude),
          ((1.0 - kEccentricity2) * radius + position.height_m) * std::sin(latitude)};
}

GeoPosition GeodeticFromEcef(const Vector3d& ecef) {
  const double across = std::hypot(ecef.x(), ecef.y());  // from the axis of the earth
  const double semi_minor = kSemiMajorAxis_m * (1.0 - kFlattening);
  const double second_eccentricity2 = kEccentricity2 / (1.0 - kEccentricity2);
  // Parametric latitude, as sine and cosine so that the poles are no exception. Two rounds are exact to a nanometre
  // near the ground; the others are for satellites.
  double parametric = std::atan2(ecef.z(), (1.0 - kFlattening) * across);
  double latitude = 0.0;
  for (int i = 0; i < 5; ++i) {
    const double sine = std::sin(parametric), cosine = std::cos(parametric);
    latitude = std::atan2(ecef.z() + second_eccentricity2 * semi_minor * sine * sine * sine,
                          across - kEccentricity2 * kSemiMajorAxis_m * cosine * cosine * cosine);
    parametric = std::atan2((1.0 - kFlattening) * std::sin(latitude), std::cos(latitude));
  }
  const double sine = std::sin(latitude);
  GeoPosition position;
  position.latitude_deg = latitude / kRadPerDeg;
  position.longitude_deg = across > 0.0 ? std::atan2(ecef.y(), ecef.x()) / kRadPerDeg : 0.0;
  position.height_m =
      across * std::cos(latitude) + ecef.z() * sine - kSemiMajorAxis_m * std::sqrt(1.0 - kEccentricity2 * sine * sine);
  return position;
}

Quaterniond EnuFromEcef(const GeoPosition& position) {
  const double latitude = position.latitude_deg * kRadPerDeg, longitude = position.longitude_deg * kRadPerDeg;
  const double sin_lat = std::sin(latitude), cos_lat = std::cos(latitude);
  const double sin_lon = std::sin(longitude), cos_lon = std::cos(longitude);
  Matrix3d rows;
  rows << -sin_lon, cos_lon, 0.0,                       // east
      -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat,  // north
      cos_lat * cos_lon, cos_lat * sin_lon, sin_lat;    // up
  return Quaterniond(rows).normalized();
}

Vector3d EnuFromGeodetic(const GeoPosition& position, const GeoPosition& origin) {
  return EnuFromEcef(origin) * (EcefFromGeodetic(position) - EcefFromGeodetic(origin));
}

GeoPosition GeodeticFromEnu(const Vector3d& enu, const GeoPosition& origin) {
  return GeodeticFromEcef(EcefFromGeodetic(origin) + EnuFromEcef(origin).conjugate() * enu);
}

Quaterniond EnuAtFromEnu(const GeoPosition& position, const GeoPosition& origin) {
  return EnuFromEcef(position) * EnuFromEcef(origin).conjugate();
}

}  // namespace cairn
