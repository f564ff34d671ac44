#include "geometry/geodesy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cairn {
namespace {

// The example of IOGP 373-7-2 for EPSG 9602, a point in the North Sea, and its origin for EPSG 9837.
const GeoPosition kNorthSea = {53.0 + 48.0 / 60.0 + 33.820 / 3600.0, 2.0 + 7.0 / 60.0 + 46.380 / 3600.0, 73.0};
const Vector3d kNorthSeaEcef(3771793.968, 140253.342, 5124304.349);
const GeoPosition kOrigin = {55.0, 5.0, 200.0};

void ExpectSame(const GeoPosition& a, const GeoPosition& b) {
  EXPECT_NEAR(a.latitude_deg, b.latitude_deg, 1e-12);
  EXPECT_NEAR(a.longitude_deg, b.longitude_deg, 1e-12);
  EXPECT_NEAR(a.height_m, b.height_m, 1e-8);
}

TEST(Geodesy, KnownPointsInEcef) {
  EXPECT_LT((EcefFromGeodetic(kNorthSea) - kNorthSeaEcef).norm(), 1e-3);
  EXPECT_LT((EcefFromGeodetic({0.0, 0.0, 0.0}) - Vector3d(6378137.0, 0.0, 0.0)).norm(), 1e-6);
  EXPECT_LT((EcefFromGeodetic({0.0, 90.0, 5.0}) - Vector3d(0.0, 6378142.0, 0.0)).norm(), 1e-6);
  EXPECT_LT((EcefFromGeodetic({90.0, 0.0, 0.0}) - Vector3d(0.0, 0.0, 6356752.314245)).norm(), 1e-5);
}

TEST(Geodesy, KnownPointInEnu) {
  const Vector3d enu = EnuFromGeodetic(kNorthSea, kOrigin);
  EXPECT_NEAR(enu.x(), -189013.869, 2e-3);
  EXPECT_NEAR(enu.y(), -128642.040, 2e-3);
  EXPECT_NEAR(enu.z(), -4220.171, 2e-3);
  ExpectSame(GeodeticFromEnu(enu, kOrigin), kNorthSea);
}

TEST(Geodesy, BackFromEcefEverywhere) {
  for (const double latitude : {-90.0, -89.999999, -45.0, -1e-9, 0.0, 30.0, 60.1699, 89.9, 90.0}) {
    for (const double longitude : {-179.9, -90.0, 0.0, 24.9384, 180.0}) {
      for (const double height : {-4000.0, 0.0, 8848.0, 99000.0}) {
        const GeoPosition back = GeodeticFromEcef(EcefFromGeodetic({latitude, longitude, height}));
        EXPECT_NEAR(back.latitude_deg, latitude, 1e-10);
        EXPECT_NEAR(back.height_m, height, 1e-6);
        if (std::abs(latitude) < 89.9999) {
          EXPECT_NEAR(back.longitude_deg, longitude, 1e-10);
        }
      }
    }
  }
  const GeoPosition pole = GeodeticFromEcef({0.0, 0.0, -6356752.314245 - 10.0});
  EXPECT_NEAR(pole.latitude_deg, -90.0, 1e-12);
  EXPECT_EQ(pole.longitude_deg, 0.0);
  EXPECT_NEAR(pole.height_m, 10.0, 1e-5);
}

TEST(Geodesy, AxesOfTheTangentPlane) {
  // At 0, 0: up is x, east is y, north is z.
  const Quaterniond enu_from_ecef = EnuFromEcef({0.0, 0.0, 0.0});
  EXPECT_LT((enu_from_ecef * Vector3d::UnitX() - Vector3d::UnitZ()).norm(), 1e-15);
  EXPECT_LT((enu_from_ecef * Vector3d::UnitY() - Vector3d::UnitX()).norm(), 1e-15);
  EXPECT_LT((enu_from_ecef * Vector3d::UnitZ() - Vector3d::UnitY()).norm(), 1e-15);
  // A degree further north the axes have turned by one about east.
  const Quaterniond turned = EnuAtFromEnu({1.0, 0.0, 0.0}, {0.0, 0.0, 0.0});
  EXPECT_NEAR(AngleRad(turned), M_PI / 180.0, 1e-12);
  EXPECT_LT((turned * Vector3d::UnitX() - Vector3d::UnitX()).norm(), 1e-12);
  EXPECT_LT((turned * Vector3d::UnitZ()).y(), 0.0) << "what is up there leans to the south here";
}

TEST(Geodesy, PositionsThatAreNone) {
  EXPECT_TRUE(kNorthSea.Validate().ok());
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const GeoPosition& bad :
       {GeoPosition{90.1, 0.0, 0.0}, GeoPosition{0.0, 180.5, 0.0}, GeoPosition{0.0, 0.0, 2e5},
        GeoPosition{kNan, 0.0, 0.0}, GeoPosition{0.0, kNan, 0.0}, GeoPosition{0.0, 0.0, kNan}}) {
    EXPECT_EQ(bad.Validate().code(), absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace cairn
