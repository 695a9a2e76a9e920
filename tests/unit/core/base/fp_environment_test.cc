// SPDX-License-Identifier: Apache-2.0
#include "core/base/fp_environment.h"

#include <gtest/gtest.h>

#include <cfenv>

#ifdef __SSE2__
#include <xmmintrin.h>
#endif

namespace kdray::core {
namespace {

/// Restores rounding and, on x86, the flags for denormals.
class FpEnvironment : public testing::Test {
 protected:
  FpEnvironment() { std::fegetenv(&saved_); }
  ~FpEnvironment() override { std::fesetenv(&saved_); }

 private:
  std::fenv_t saved_;
};

TEST_F(FpEnvironment, IsSoundAsTheProcessStarts) {
  EXPECT_TRUE(CheckFloatingPointEnvironment().ok());
}

TEST_F(FpEnvironment, RefusesEveryRoundingButToNearest) {
  for (const int rounding : {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO}) {
    ASSERT_EQ(std::fesetround(rounding), 0);
    const Status status = CheckFloatingPointEnvironment();
    ASSERT_EQ(std::fesetround(FE_TONEAREST), 0);
    ASSERT_FALSE(status.ok()) << "rounding mode " << rounding;
    EXPECT_NE(status.error().message.find("rounding"), std::string::npos);
  }
}

#ifdef __SSE2__
TEST_F(FpEnvironment, RefusesFlushToZeroAndDenormalsAreZero) {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040;
  for (const unsigned flag : {kFlushToZero, kDenormalsAreZero}) {
    const unsigned before = _mm_getcsr();
    _mm_setcsr(before | flag);
    const Status status = CheckFloatingPointEnvironment();
    _mm_setcsr(before);
    ASSERT_FALSE(status.ok()) << "flag " << flag;
    EXPECT_NE(status.error().message.find("denormal"), std::string::npos);
  }
}
#endif

}  // namespace
}  // namespace kdray::core
