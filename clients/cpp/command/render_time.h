// SPDX-License-Identifier: Apache-2.0
// How long a render will take. The server does not tell how far a picture is, so a small picture of
// the same view is rendered first and its time is scaled.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "kdray/client.h"

namespace kdray::client {

struct RenderWork {
  double pixels = 640 * 480;  ///< that will be sent: of the region, or of the whole picture
  bool may_be_long = false;   ///< more than a small part of a second
};

/// Numbers that are not valid count as absent; the server reports them.
RenderWork RenderWorkOf(const Parameters& fields);

/// The expected duration; nullopt if the render is too short for a bar. Exact under budget_ms. Else
/// it costs a picture of 1/64 of the pixels, and is within some tenths of the truth, because the
/// time is nearly proportional to the pixels. Never throws for a refusal: the render itself reports
/// it.
std::optional<std::chrono::duration<double>> ExpectedTime(Client& client, const std::string& id,
                                                          const std::string& format,
                                                          const Parameters& fields);

}  // namespace kdray::client
