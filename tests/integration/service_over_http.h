// SPDX-License-Identifier: Apache-2.0
// A service over a real socket, with a backend that has no geometry.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/fake_backend.h"
#include "tests/support/npy_array.h"
#include "tests/support/service_fixture.h"
#include "tests/support/wait_until.h"

namespace kdray::server {

inline constexpr const char* kRays = R"({"rays":[[0,0,1,0,0,-1],[0,0,1,0,0,1]]})";
inline constexpr const char* kUnknownId =
    "0000000000000000000000000000000000000000000000000000000000000000-auto";

inline std::string NpyRays(const std::vector<float>& numbers) { return test::NpyArray(numbers, 6); }

class ServiceOverHttp : public testing::Test {
 protected:
  explicit ServiceOverHttp(ServiceOptions options = {}, HttpServerOptions http = {})
      : running_(backend_, std::move(options), std::move(http)) {}
  ~ServiceOverHttp() override { backend_.hold = false; }

  std::string Tree(const std::string& path) {
    if (id_.empty()) id_ = running_.Upload("mesh");
    return "/v1/trees/" + id_ + path;
  }
  static void WaitFor(const auto& condition) { ASSERT_TRUE(test::WaitUntil(condition)); }

  test::FakeBackend backend_;
  test::RunningService running_;
  std::string id_;
};

}  // namespace kdray::server
