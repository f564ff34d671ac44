// Positions on the earth (WGS 84), and the Cartesian frames that go with them.
//
//   geodetic  latitude and longitude in degrees, height above the ellipsoid (not above the sea) in metres
//   ecef      earth-centred, earth-fixed, metres: x to latitude 0, longitude 0; z to the north pole
//   enu       east, north, up at an origin, metres: the tangent plane there
//
// Ellipsoid: NGA.STND.0036, "World Geodetic System 1984". Formulas: IOGP Publication 373-7-2, "Coordinate conversions
// and transformations", methods EPSG 9602 (ecef) and 9837 (enu); from ecef by Bowring's iteration on the parametric
// latitude ("Transformation from spatial to geographical coordinates", Survey Review 181, 1976).
#pragma once

#include "base/status.h"
#include "geometry/se3.h"

namespace cairn {

struct GeoPosition {
  double latitude_deg = 0.0;   // north is positive
  double longitude_deg = 0.0;  // east is positive
  double height_m = 0.0;       // above the ellipsoid

  // InvalidArgument unless latitude and longitude are within 90 and 180 degrees, and the height within 100 km.
  absl::Status Validate() const;
};

Vector3d EcefFromGeodetic(const GeoPosition& position);
// Longitude in (-180, 180]; at the poles it is 0. For points more than 1000 km from the centre of the earth.
GeoPosition GeodeticFromEcef(const Vector3d& ecef);

// The axes of east, north, up at a position: enu_from_ecef, a rotation.
Quaterniond EnuFromEcef(const GeoPosition& position);

Vector3d EnuFromGeodetic(const GeoPosition& position, const GeoPosition& origin);
GeoPosition GeodeticFromEnu(const Vector3d& enu, const GeoPosition& origin);
// From the axes at `origin` to those at `position`: over a kilometre they turn by a hundredth of a degree.
Quaterniond EnuAtFromEnu(const GeoPosition& position, const GeoPosition& origin);

}  // namespace cairn
