// Whole files, under the names by which this module knows them.
#pragma once

#include "base/files.h"

namespace cairn::io {

using cairn::ReadWholeFile;
using cairn::WriteFileAtomically;

}  // namespace cairn::io
