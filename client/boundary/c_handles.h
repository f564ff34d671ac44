// What the handles of cairn.h are.
#pragma once

#include "cairn.h"
#include "cairn/call_options.h"
#include "cairn/map.h"

struct cairn_cancellation {
  cairn::v0::Cancellation cancellation;
};
struct cairn_map {
  cairn::v0::Map map;
};
struct cairn_localizer {
  cairn::v0::Localizer localizer;
};
struct cairn_tracker {
  cairn::v0::Tracker tracker;
};
