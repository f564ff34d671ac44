// Fonts of figures: DejaVu Sans, and for names in scripts that it does not have what else is installed.
#pragma once

#include <cairo/cairo.h>

#include <string>

namespace cairn::plot {

// To be given to cairo_set_font_face() and then destroyed. Of all installed fonts the one that has most of the
// characters of `text`, DejaVu Sans if it has as many.
cairo_font_face_t* FontFor(const std::string& text, bool bold);

}  // namespace cairn::plot
