// Reading and writing large batches ends soon after it is told to stop.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "api/batch_codec.h"
#include "api/npy.h"
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

std::string NpyBody(bool fortran) {
  const std::vector<std::size_t> shape = {kRows, 6};
  std::string body = NpyHeader("'<f8'", shape);
  if (fortran) body.replace(body.find("False"), 5, "True ");
  return body + std::string(kRows * 6 * sizeof(double), '\0');
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
          {"npy", NpyBody(false), BatchType::kNpy},
          {"npy in Fortran order", NpyBody(true), BatchType::kNpy}};
}

TEST(StoppedBatch, IsNotReadToItsEnd) {
  for (const Body& body : Bodies()) {
    Stopper never(std::numeric_limits<std::uint64_t>::max());
    static_cast<void>(DecodeRays(body.text, body.type, {}, {}, never.function()));
    EXPECT_GE(never.looks(), 40U) << body.name << ": it looks all along";
    for (const std::uint64_t noes : {std::uint64_t{0}, std::uint64_t{7}, never.looks() / 2}) {
      Stopper stopper(noes);
      const auto rays = DecodeRays(body.text, body.type, {}, {}, stopper.function());
      ASSERT_TRUE(stopper.has_stopped()) << body.name;
      EXPECT_LT(stopper.late(), test::kPromptly) << body.name;
      EXPECT_FALSE(rays) << body.name;
      EXPECT_LE(stopper.looks(), noes + 2) << body.name << ": it goes on";
    }
  }
}

TEST(StoppedBatch, IsNotWrittenToItsEnd) {
  ClosestAnswer closest;
  closest.hits.assign(kRows, {0.1, 0.25, 0.5, 7});
  closest.normals.assign(kRows, {0, 0.6f, 0.8f});
  closest.points.assign(kRows, {0.1, 0.2, 0.3});
  AnyAnswer any;
  any.occluded.assign(kRows, 1);
  const RayTable rays{{kRows}, std::vector<RayRow<double>>(kRows), NumberType::kF8};
  RayOptions options;
  options.fields = {RayField::kT, RayField::kTriangle, RayField::kNormal, RayField::kPoint};
  for (const BatchType type : {BatchType::kJson, BatchType::kNpy}) {
    for (const bool is_any : {false, true}) {
      const auto encode = [&](const ShouldStop& should_stop) {
        return is_any ? EncodeAny(any, rays, type, should_stop)
                      : EncodeClosest(closest, rays, options, type, should_stop);
      };
      Stopper never(std::numeric_limits<std::uint64_t>::max());
      EXPECT_EQ(encode(never.function()), encode({}));
      EXPECT_GE(never.looks(), kRows / 2000);
      Stopper stopper(never.looks() / 2);
      EXPECT_TRUE(encode(stopper.function()).empty());
      ASSERT_TRUE(stopper.has_stopped());
      EXPECT_LT(stopper.late(), test::kPromptly);
    }
  }
}

}  // namespace
}  // namespace kdray::api
