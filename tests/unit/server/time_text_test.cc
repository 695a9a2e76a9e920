// SPDX-License-Identifier: Apache-2.0
#include "server/http/time_text.h"

#include <gtest/gtest.h>

namespace kdray::server {
namespace {

TEST(TimeText, Rfc3339IsUtcWithMilliseconds) {
  EXPECT_EQ(Rfc3339(0), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(Rfc3339(1'700'000'000'123), "2023-11-14T22:13:20.123Z");
  EXPECT_EQ(Rfc3339(951'782'400'007), "2000-02-29T00:00:00.007Z");
  EXPECT_EQ(Rfc3339(-1), "1970-01-01T00:00:00.000Z");
}

TEST(TimeText, HttpDatesNameDayAndMonthInEnglish) {
  EXPECT_EQ(HttpDate(784'111'777'000), "Sun, 06 Nov 1994 08:49:37 GMT");  // RFC 9110, 5.6.7
  EXPECT_EQ(HttpDate(951'782'400'007), "Tue, 29 Feb 2000 00:00:00 GMT");
}

}  // namespace
}  // namespace kdray::server
