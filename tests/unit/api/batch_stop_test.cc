// SPDX-License-Identifier: Apache-2.0
// Reading a large JSON batch ends soon after it is told to stop. (Arrays are read block by block,
// by the backend, which looks between.)
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "api/batch_codec.h"
#include "tests/support/cancel_probe.h"

namespace kdray::api {
namespace {

using std::chrono::nanoseconds;

constexpr std::size_t kRows = 200'000;

// Answers no `noes` times, then yes, and remembers when.
class Stopper {
 public:
  explicit Stopper(std::uint64_t noes) : noes_(noes) {}

  ShouldStop function() {
    return [this] {
      ++looks_;
      if (looks_ <= noes_) return false;
      if (looks_ == noes_ + 1) stopped_at_ = test::ThreadTime();
      return true;
    };
  }
  std::uint64_t looks() const { return looks_; }
  bool has_stopped() const { return looks_ > noes_; }
  nanoseconds late() const { return test::ThreadTime() - stopped_at_; }

 private:
  std::uint64_t noes_;
  std::uint64_t looks_ = 0;
  nanoseconds stopped_at_{0};
};

struct Body {
  std::string name;
  std::string text;
  BatchType type = BatchType::kJson;
};

BatchWork WorkWith(Stopper* stopper) {
  return {.should_stop = stopper->function(), .run = {}, .charge = {}};
}

std::vector<Body> Bodies() {
  std::string rows = "{\"rays\":[[1,2,3,4,5,6]";
  for (std::size_t i = 1; i < kRows; ++i) rows += ",[0.1234567,0.25,-1e-3,1,0,0,0.5,null]";
  rows += "]}";
  const std::string long_part(4'000'000, '1');
  return {{"rows", rows},
          {"a number", "{\"rays\":[[" + long_part + "]]}"},
          {"blanks", "{" + std::string(4'000'000, ' ') + "\"rays\":[]}"},
          {"a key", "{\"" + long_part + "\":[]}"},
          {"rows for the slow reader", "{\"r\\u0061ys\"" + rows.substr(7)}};
}

TEST(StoppedBatch, IsNotReadToItsEnd) {
  for (const Body& body : Bodies()) {
    Stopper never(std::numeric_limits<std::uint64_t>::max());
    static_cast<void>(DecodeRays(body.text, body.type, {}, {}, WorkWith(&never)));
    EXPECT_GE(never.looks(), 40U) << body.name << ": it looks all along";
    for (const std::uint64_t noes : {std::uint64_t{0}, std::uint64_t{7}, never.looks() / 2}) {
      Stopper stopper(noes);
      const auto rays = DecodeRays(body.text, body.type, {}, {}, WorkWith(&stopper));
      ASSERT_TRUE(stopper.has_stopped()) << body.name;
      EXPECT_LT(stopper.late(), test::kPromptly) << body.name;
      EXPECT_FALSE(rays) << body.name;
      EXPECT_LE(stopper.looks(), noes + 2) << body.name << ": it goes on";
    }
  }
}

}  // namespace
}  // namespace kdray::api
