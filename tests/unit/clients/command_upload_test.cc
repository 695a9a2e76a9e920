// SPDX-License-Identifier: Apache-2.0
// `kdray upload` against the fake service.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "kdray/document.h"
#include "kdray/payload.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/clients/command_fixture.h"

namespace kdray::client {
namespace {

using test::ProblemJson;
using test::WriteText;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(CommandTest, UploadSendsTheFileAndPrintsTheIdAlone) {
  std::string bytes;
  for (int i = 0; i < 700'000; ++i) bytes += static_cast<char>(i * 31 >> 3);  // several chunks
  const std::string mesh = WriteMesh(bytes);
  EXPECT_EQ(Run({"upload", mesh}), kExitOk);
  EXPECT_EQ(out_.str(), IdOf(mesh) + "\n");
  EXPECT_THAT(err_.str(), HasSubstr("1,234,567 triangles, kd-sah: 99 nodes, built in 12.5 ms"));
  EXPECT_EQ(service_.Seen().back().body, bytes);
}

TEST_F(CommandTest, UploadSendsTheHashOfItsBytesByWhichProxiesFindTheServer) {
  ASSERT_EQ(Run({"upload", WriteMesh("{\"hello\": \"world\"}\n")}), kExitOk);
  const auto upload = service_.Seen().back();
  EXPECT_EQ(upload.method, "POST");
  const auto digest = upload.headers.find("content-digest");
  ASSERT_NE(digest, upload.headers.end());
  EXPECT_EQ(digest->second, "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:");  // RFC 9530
  for (const auto& request : service_.Seen()) {
    EXPECT_EQ(request.headers.count("content-digest"), request.body.empty() ? 0u : 1u)
        << request.target;
  }
}

TEST_F(CommandTest, UploadReadsNothingIfStandardInputIsGivenTwice) {
  EXPECT_EQ(Run({"upload", WriteMesh(), "-", "-"}), kExitUsage);
  EXPECT_THAT(err_.str(), HasSubstr("'-' is given twice"));
  EXPECT_THAT(service_.Seen(), IsEmpty());
}

TEST_F(CommandTest, UploadSendsNothingThatTheServerHas) {
  const std::string mesh = WriteMesh();
  ASSERT_EQ(Run({"upload", mesh}), kExitOk);
  const std::size_t before = service_.Targets("POST").size();
  EXPECT_EQ(Run({"upload", mesh}), kExitOk);
  EXPECT_EQ(service_.Targets("POST").size(), before);
  EXPECT_EQ(out_.str(), IdOf(mesh) + "\n");
  EXPECT_THAT(err_.str(), HasSubstr("already has this tree"));
}

TEST_F(CommandTest, UploadOfAnotherBuildNamesTheMeshInsteadOfSendingIt) {
  const std::string mesh = WriteMesh();
  ASSERT_EQ(Run({"upload", mesh}), kExitOk);
  EXPECT_EQ(Run({"upload", mesh, "--build", "kd-median"}), kExitOk);
  EXPECT_EQ(out_.str(), IdOf(mesh, "kd-median") + "\n");
  const auto last = service_.Seen().back();
  EXPECT_EQ(last.method, "POST");
  EXPECT_THAT(last.target, HasSubstr("mesh=" + IdOf(mesh, "").substr(0, 64)));
  EXPECT_THAT(last.body, IsEmpty());
}

TEST_F(CommandTest, UploadWaitsForTheBuildAndTellsHowFarItIs) {
  service_.polls_until_ready = 3;
  const std::string mesh = WriteMesh();
  EXPECT_EQ(Run({"upload", mesh}), kExitOk);
  EXPECT_THAT(err_.str(), AllOf(HasSubstr("uploading  100%  13 B of 13 B"),
                                HasSubstr("building   50%"), HasSubstr("building   100%")));
  EXPECT_EQ(Run({"-q", "upload", WriteMesh("other")}), kExitOk);
  EXPECT_THAT(err_.str(), IsEmpty());
}

TEST_F(CommandTest, UploadShowsWhereTheMeshIsWrong) {
  service_.AnswerOnce("POST", "/v1/trees?build",
                      {422, ProblemJson(422, "invalid_mesh", "vertex 9 of 8", R"({"line": 12})"),
                       "application/problem+json"});
  EXPECT_EQ(Run({"upload", WriteMesh()}), kExitRefused);
  EXPECT_THAT(out_.str(), IsEmpty());
  EXPECT_THAT(err_.str(), HasSubstr("kdray: invalid_mesh: vertex 9 of 8\n  HTTP 422, line 12, "
                                    "request req-7\n"));
}

TEST_F(CommandTest, UploadTriesAgainWhatFailedBefore) {
  const std::string mesh = WriteMesh();
  service_.AnswerOnce("GET", "/v1/trees/" + IdOf(mesh),
                      {503, ProblemJson(503, "memory_full", "later"), "application/problem+json"});
  EXPECT_EQ(Run({"upload", mesh}), kExitOk);
}

TEST_F(CommandTest, UploadDoesNotSendWhatIsLargerThanTheServerTakes) {
  service_.max_upload_bytes = 10;
  EXPECT_EQ(Run({"upload", WriteMesh("12345678901")}), kExitRefused);
  EXPECT_THAT(err_.str(), AllOf(HasSubstr("mesh_too_large"), HasSubstr("limit 10, sent 11")));
  for (const auto& request : service_.Seen()) EXPECT_THAT(request.body, IsEmpty());
}

TEST_F(CommandTest, UploadOfAMissingFileIsALocalError) {
  EXPECT_EQ(Run({"upload", folder_ / "no.ply"}), kExitLocalFile);
  EXPECT_THAT(err_.str(), HasSubstr("no.ply: No such file"));
  EXPECT_EQ(Run({"upload", folder_.path().string()}), kExitLocalFile);
  EXPECT_THAT(err_.str(), HasSubstr("no mesh file in this directory"));
  EXPECT_EQ(Run({"upload", folder_ / "*.ply"}), kExitLocalFile);
  EXPECT_THAT(err_.str(), HasSubstr("*.ply: no file matches this pattern"));
  EXPECT_EQ(Run({"upload", "/dev/null"}), kExitLocalFile);
  EXPECT_THAT(err_.str(), HasSubstr("not a regular file"));
  EXPECT_THAT(service_.Seen(), IsEmpty());
}

TEST_F(CommandTest, UploadOfAnEmptyFileIsTheServersToRefuse) {
  EXPECT_EQ(Run({"upload", WriteMesh("")}), kExitOk);
  EXPECT_EQ(service_.Seen().back().headers.find("content-length")->second, "0");
}

TEST_F(CommandTest, UploadTakesADirectoryAPatternAndSeveralAndPrintsAsSha256sumDoes) {
  for (const char* name : {"b.ply", "a.stl", "notes.txt", "c.PLY"}) {
    WriteText(folder_ / name, std::string("mesh ") + name);
  }
  const auto line = [&](const char* name) {
    return IdOf(folder_ / name) + "  " + (folder_ / name) + "\n";
  };
  EXPECT_EQ(Run({"upload", folder_.path().string()}), kExitOk);
  EXPECT_EQ(out_.str(), line("a.stl") + line("b.ply") + line("c.PLY"));
  EXPECT_EQ(Run({"upload", folder_ / "*.ply", folder_ / "a.stl"}), kExitOk);
  EXPECT_EQ(out_.str(), line("b.ply") + line("a.stl"));
  EXPECT_EQ(Run({"upload", folder_.path().string(), "--json"}), kExitOk);
  EXPECT_EQ(Document::Parse(out_.str()).value().Items().at(1)["file"].Text(), folder_ / "b.ply");
}

TEST_F(CommandTest, UploadOfSeveralGoesOnAfterABadOneAndFailsAtTheEnd) {
  WriteText(folder_ / "a.ply", "bad");
  WriteText(folder_ / "b.ply", "good");
  service_.AnswerOnce(
      "POST", "/v1/trees?build",
      {422, ProblemJson(422, "invalid_mesh", "no vertices"), "application/problem+json"});
  EXPECT_EQ(Run({"upload", folder_ / "a.ply", folder_ / "b.ply", folder_ / "no.ply"}),
            kExitRefused);
  EXPECT_EQ(out_.str(), IdOf(folder_ / "b.ply") + "  " + (folder_ / "b.ply") + "\n");
  EXPECT_THAT(err_.str(),
              AllOf(HasSubstr("a.ply: invalid_mesh: no vertices"),
                    HasSubstr("no.ply: No such file"), HasSubstr("2 of 3 files failed")));
}

}  // namespace
}  // namespace kdray::client
