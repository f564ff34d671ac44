// A second opinion on the alignment of a frame, independent of the photometric residuals that made it.
//
// An alignment to an image of another place leaves residuals of which a fair share is small, since large parts of every
// image are smooth. It does not, however, reproduce the pattern of light and dark: here the intensities of the
// reference's points are correlated with those of the image where the pose puts them, cell by cell of a grid over the
// reference. Correlation knows no gain and no offset, and a cell is right or wrong whatever happens to the others, so
// that half an image behind an obstacle leaves the other half of the cells agreeing. With long pieces cut out of a
// handheld recording, 0.00 to 0.05 of the cells of false alignments agreed; 0.31 and more of half covered views, and
// 0.71 and more of undisturbed ones.
#pragma once

#include "direct/coarse_tracker.h"
#include "direct/image_pyramid.h"
#include "direct/view_cells.h"
#include "geometry/se3.h"

namespace cairn::direct {

struct AlignmentAgreement {
  int cells = 0;             // in view, with texture
  CellSet disagreeing = {};  // cells of the reference with a correlation below kDisagreeingCorrelation
  int agreeing = 0;          // of these, with a correlation of at least kAgreeingCorrelation
  double share() const { return cells > 0 ? static_cast<double>(agreeing) / cells : 0.0; }
};

inline constexpr double kAgreeingCorrelation = 0.7;
inline constexpr double kDisagreeingCorrelation = 0.4;

AlignmentAgreement CheckAlignment(const PyramidGeometry& geometry, const TrackingReference& reference,
                                  const ImagePyramid& image, const SE3& new_from_reference);

// The reference's points outside of some of its cells; `rest` keeps its memory, and gets no thumbnail.
void WithoutCells(const PyramidGeometry& geometry, const TrackingReference& reference, const CellSet& without,
                  TrackingReference* rest);

}  // namespace cairn::direct
