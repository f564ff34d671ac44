/// \file
/// What the library exports. Everything else in libcairn.so is hidden.
#pragma once

#if defined(__GNUC__)
/// Marks what is exported.
#define CAIRN_API __attribute__((visibility("default")))
/// Marks what is not, inside of something that is.
#define CAIRN_HIDDEN __attribute__((visibility("hidden")))
#else
#define CAIRN_API
#define CAIRN_HIDDEN
#endif

// Public names are in cairn::v0, which is inline: a program writes cairn::Map, and the linker sees which version of the
// interface it was compiled for. Cairn's own sources have names of their own in cairn (a Camera, for one) and see v0 as
// any other namespace.
#if defined(CAIRN_BUILDS_ITSELF)
#define CAIRN_BEGIN_NAMESPACE \
  namespace cairn {           \
  namespace v0 {
#else
#define CAIRN_BEGIN_NAMESPACE \
  namespace cairn {           \
  inline namespace v0 {
#endif
/// Ends what CAIRN_BEGIN_NAMESPACE began.
#define CAIRN_END_NAMESPACE \
  }                         \
  }
