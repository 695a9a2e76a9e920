// SPDX-License-Identifier: Apache-2.0
// `kdray` as a whole, in this process, against the fake service. command_upload_test.cc has
// uploads, command_batch_test.cc renders and batches, command_test.cc all other commands.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstddef>
#include <sstream>
#include <string>
#include <vector>

#include "clients/cpp/command/command.h"
#include "kdray/payload.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/clients/fake_service.h"

namespace kdray::client {

inline const std::string kDigestA(64, 'a');
inline const std::string kDigestB = "aaaaaaab" + std::string(56, '0');

class CommandTest : public ::testing::Test {
 protected:
  CommandTest() { std::signal(SIGPIPE, SIG_IGN); }

  int Run(std::vector<std::string> arguments) {
    out_.str({});
    err_.str({});
    arguments.insert(arguments.begin(), {"--server", service_.Url()});
    return RunCommand(arguments, {.out = out_,
                                  .err = err_,
                                  .out_columns = columns_,
                                  .patience = std::chrono::milliseconds(0)});
  }

  std::string WriteMesh(const std::string& bytes = "ply and so on") {
    test::WriteText(folder_ / "mesh.ply", bytes);
    return folder_ / "mesh.ply";
  }

  std::string IdOf(const std::string& path, const std::string& build = "auto") {
    return Payload::OfFile(path).Sha256() + "-" + build;
  }

  test::FakeService service_;
  test::TemporaryFolder folder_;
  std::ostringstream out_;
  std::ostringstream err_;
  std::size_t columns_ = 0;
};

}  // namespace kdray::client
