// SPDX-License-Identifier: Apache-2.0
// The metrics that others count: values of CurrentValues as families of prometheus-cpp. For
// server/metrics.cc.
#pragma once

#include <prometheus/metric_family.h>

#include <vector>

#include "server/metrics.h"

namespace kdray::server {

/// Appends a family for each value that `now` has.
void AppendCurrent(const CurrentValues& now, std::vector<prometheus::MetricFamily>& families);

}  // namespace kdray::server
