// What can go wrong in the client library. It throws: a caller with no better idea prints what()
// and ends, which is what `kdray` does.
#pragma once

#include <stdexcept>
#include <string>

#include "clients/cpp/client/problem.h"

namespace kdray::client {

/// The caller's own words are wrong: an URL that is none, an id that names nothing or too much.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A file on this machine cannot be read, written, or is not what it should be.
struct LocalFileError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// No connection to the server, or it broke before the answer was complete.
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
