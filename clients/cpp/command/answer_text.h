// An answer's headers in words.
#pragma once

#include <string>

#include "clients/cpp/client/transport.h"

namespace kdray::client {

/// "watertight precision, traced in 23 ms, 3 invalid rows": from Kdray-Precision, Server-Timing,
/// Kdray-Invalid, Kdray-Truncated and Kdray-Samples, if present.
std::string AnswerText(const HttpResponse& response);

/// The duration of one metric of a Server-Timing header: ("queue;dur=0.1, trace;dur=23", "trace")
/// gives "23"; "" if it is absent.
std::string TimingOf(const std::string& server_timing, const std::string& metric);

}  // namespace kdray::client
