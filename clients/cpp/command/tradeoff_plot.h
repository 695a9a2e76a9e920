// SPDX-License-Identifier: Apache-2.0
// A mesh's measured trade-off as a figure.
#pragma once

#include "clients/cpp/command/plot.h"
#include "kdray/document.h"

namespace kdray::client {

/// Leaks and errors of t over the speed of aimed rays: a point for every build with every
/// precision. A rate of zero is drawn at its bound.
Plot PlotOf(const Document& tradeoff);

}  // namespace kdray::client
