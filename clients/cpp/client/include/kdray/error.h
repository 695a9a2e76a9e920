// SPDX-License-Identifier: Apache-2.0
// The exceptions of the client library. `kdray` prints what() and ends.
#pragma once

#include <stdexcept>
#include <string>

#include "kdray/problem.h"

namespace kdray::client {

/// An invalid argument: an invalid URL, or an id that matches no tree or several.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A local file cannot be read or written, or has the wrong format.
struct LocalFileError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// No connection to the server, or the connection broke before the answer was complete.
struct ConnectionError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The server answered with an error.
struct Refusal : std::runtime_error {
  explicit Refusal(Problem refused_with)
      : std::runtime_error(FormatProblem(refused_with)), problem(std::move(refused_with)) {}

  Problem problem;
};

}  // namespace kdray::client
