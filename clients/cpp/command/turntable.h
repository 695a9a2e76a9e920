// SPDX-License-Identifier: Apache-2.0
// The cameras of `kdray render --turntable N`.
#pragma once

#include <string>
#include <vector>

#include "kdray/document.h"
#include "kdray/server_url.h"

namespace kdray::client {

/// The request's fields for each of `count` pictures, whose camera goes once around the mesh at
/// equal angles, counter-clockwise seen from above. It turns `up` through `target` if `eye` is
/// given, else around the middle of the mesh, at a distance from which the mesh fits in every
/// picture; it begins where `view` stands. Depth pictures (not arrays) share their greys. Throws
/// UsageError for fields that have no such camera: spherical, extrinsic, a view from the top or
/// bottom, an eye on the axis.
std::vector<Parameters> TurntableFrames(const Parameters& fields, const Document& description,
                                        const std::string& format, int count);

/// `turn.png` -> `turn-07.png`, with as many digits as the last number has. "-" stays.
std::string FrameName(const std::string& output, int frame, int count);

}  // namespace kdray::client
