#include "plot/fonts.h"

#include <cairo/cairo-ft.h>
#include <fontconfig/fontconfig.h>

#include <algorithm>
#include <memory>

namespace cairn::plot {
namespace {

constexpr const char* kFamily = "DejaVu Sans";

struct DestroyPattern {
  void operator()(FcPattern* pattern) const { FcPatternDestroy(pattern); }
};
struct DestroyCharSet {
  void operator()(FcCharSet* characters) const { FcCharSetDestroy(characters); }
};
using Pattern = std::unique_ptr<FcPattern, DestroyPattern>;
using CharSet = std::unique_ptr<FcCharSet, DestroyCharSet>;

CharSet CharactersOf(const std::string& text) {
  CharSet characters(FcCharSetCreate());
  const auto* at = reinterpret_cast<const FcChar8*>(text.data());
  auto left = static_cast<int>(text.size());
  while (left > 0) {
    FcChar32 character = 0;
    const int bytes = FcUtf8ToUcs4(at, &character, left);
    if (bytes <= 0) break;
    FcCharSetAddChar(characters.get(), character);
    at += bytes;
    left -= bytes;
  }
  return characters;
}

// Null if fontconfig has nothing to say.
Pattern Match(const std::string& text, bool bold) {
  const CharSet characters = CharactersOf(text);
  const Pattern wanted(FcPatternCreate());
  FcPatternAddString(wanted.get(), FC_FAMILY, reinterpret_cast<const FcChar8*>(kFamily));
  FcPatternAddInteger(wanted.get(), FC_WEIGHT, bold ? FC_WEIGHT_BOLD : FC_WEIGHT_REGULAR);
  FcPatternAddCharSet(wanted.get(), FC_CHARSET, characters.get());
  FcConfigSubstitute(nullptr, wanted.get(), FcMatchPattern);
  FcDefaultSubstitute(wanted.get());
  FcResult result = FcResultNoMatch;
  Pattern found(FcFontMatch(nullptr, wanted.get(), &result));
  return result == FcResultMatch ? std::move(found) : nullptr;
}

bool IsLatin(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x80; });
}

}  // namespace

cairo_font_face_t* FontFor(const std::string& text, bool bold) {
  const Pattern found = IsLatin(text) ? nullptr : Match(text, bold);
  if (found != nullptr) return cairo_ft_font_face_create_for_pattern(found.get());
  return cairo_toy_font_face_create(kFamily, CAIRO_FONT_SLANT_NORMAL,
                                    bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
}

}  // namespace cairn::plot
