#include "cli/sample_statistics.h"

namespace cairn::cli {

nlohmann::ordered_json SampleStatistics(const SampleReservoir& samples) {
  return {{"median", samples.Percentile(0.5)},
          {"mean", samples.mean()},
          {"p99", samples.Percentile(0.99)},
          {"max", samples.max()}};
}

}  // namespace cairn::cli
