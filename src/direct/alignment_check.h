// A second opinion on the alignment of a frame, independent of the photometric residuals that made it.
//
// An alignment to an image of another place leaves residuals of which a fair share is small, since large parts of every
// image are smooth. It does not, however, reproduce the pattern of light and dark: here the intensities of the
// reference's points are correlated with those of the image where the pose puts them, cell by cell of a grid over the
// view. Correlation knows no gain and no offset, and a cell is right or wrong whatever happens to the others, so
// that half an image behind an obstacle leaves the other half of the cells agreeing. With long pieces cut out of a
// handheld recording, 0.00 to 0.05 of the cells of false alignments agreed; 0.31 and more of half covered views, and
// 0.71 and more of undisturbed ones.
//
// A cell's pattern may also be looked for nearby: a cell that is found a few pixels off says that the pose errs, one
// that is found nowhere that something stands before it.
#pragma once

#include <array>
#include <tuple>
#include <vector>

#include "direct/coarse_tracker.h"
#include "direct/image_pyramid.h"
#include "direct/view_cells.h"
#include "geometry/se3.h"

namespace cairn::direct {

inline constexpr double kAgreeingCorrelation = 0.7;
inline constexpr double kDisagreeingCorrelation = 0.4;

enum class CellGrid { kReference, kImage };  // where a point's cell is: where it was, or where it is expected

struct CellMatch {
  bool known = false;        // enough points are in view, and they have texture
  double correlation = 0.0;  // of their intensities, the best of the shifts that were tried
};
using CellMatches = std::array<CellMatch, std::tuple_size_v<CellSet>>;

class CellMatcher {
 public:
  // Shifts of up to `reach_px` pixels of the level above the finest are tried in both directions for cells that do not
  // agree without.
  CellMatches Match(const PyramidGeometry& geometry, const TrackingReference& reference, const ImagePyramid& image,
                    const SE3& new_from_reference, CellGrid grid, int reach_px);

 private:
  struct Sample {
    int u, v;
    float a, b;  // fractions of a pixel
    float color;
  };
  struct Cell {
    int points = 0;  // of the reference
    std::vector<Sample> visible;
  };
  static double Correlation(const Cell& cell, const ImagePyramid& image, int level, int dx, int dy);

  std::array<Cell, std::tuple_size_v<CellSet>> cells_;  // keep their memory
};

struct AlignmentAgreement {
  int cells = 0;             // in view, with texture
  CellSet disagreeing = {};  // cells of the reference with a correlation below kDisagreeingCorrelation
  int agreeing = 0;          // of these, with a correlation of at least kAgreeingCorrelation
  double share() const { return cells > 0 ? static_cast<double>(agreeing) / cells : 0.0; }
};

// The cells of a reference's own grid.
AlignmentAgreement AgreementOf(const CellMatches& matches);

// The reference's points outside of some of its cells; `rest` keeps its memory, and gets no thumbnail.
void WithoutCells(const PyramidGeometry& geometry, const TrackingReference& reference, const CellSet& without,
                  TrackingReference* rest);

}  // namespace cairn::direct
