// SPDX-License-Identifier: Apache-2.0
#include "server/descriptor_limit.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

namespace kdray::server {
namespace {

TEST(DescriptorLimit, SufficesForTheConnectionsThatAreSaidToFit) {
  for (const std::size_t connections : {1UL, 2UL, 100UL, 100'000UL}) {
    EXPECT_EQ(ConnectionsWithin(DescriptorsFor(connections)), connections);
    EXPECT_LE(ConnectionsWithin(DescriptorsFor(connections) - 1), connections);
  }
  EXPECT_EQ(ConnectionsWithin(0), 1U);
  EXPECT_EQ(ConnectionsWithin(10), 1U);
}

TEST(DescriptorLimit, IsRaisedAsFarAsTheHardOneAllows) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  rlimit low = before;
  low.rlim_cur = 256;
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  const DescriptorLimit few = RaiseDescriptorLimit(10);
  EXPECT_EQ(few.descriptors, 256U) << "enough already";
  EXPECT_EQ(few.connections, 10U);
  const DescriptorLimit more = RaiseDescriptorLimit(200);
  EXPECT_EQ(more.descriptors, DescriptorsFor(200));
  EXPECT_EQ(more.connections, 200U);
  const DescriptorLimit most = RaiseDescriptorLimit(std::size_t{1} << 40);
  EXPECT_EQ(most.descriptors, before.rlim_max);
  EXPECT_EQ(most.connections, ConnectionsWithin(before.rlim_max));
  setrlimit(RLIMIT_NOFILE, &before);
}

}  // namespace
}  // namespace kdray::server
