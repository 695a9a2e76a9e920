// SPDX-License-Identifier: Apache-2.0
// `kdray` against the fake service: trees, a server that is absent, and the command line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "kdray/document.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/clients/command_fixture.h"

namespace kdray::client {
namespace {

using test::FakeService;
using test::ReadText;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

// ---- trees ----

TEST_F(CommandTest, ListShowsEveryPage) {
  service_.page_size = 2;
  for (const char digit : {'a', 'b', 'c', 'd', 'e'})
    service_.AddTree(std::string(64, digit) + "-bvh");
  EXPECT_EQ(Run({"list"}), kExitOk);
  EXPECT_THAT(out_.str(),
              AllOf(StartsWith("ID                TRIANGLES  BUILD"),
                    HasSubstr("\neeeeeeeeeeee-bvh  1,234,567  kd-sah  ready  ply     2.0 KiB  "
                              "2026-01-02 03:04\n"),
                    HasSubstr("\naaaaaaaaaaaa-bvh  ")));
  EXPECT_EQ(Run({"list", "--json"}), kExitOk);
  EXPECT_EQ(Document::Parse(out_.str()).value().Items().size(), 5u);
}

TEST_F(CommandTest, AnIdMayBeCutToWhatNamesOneTree) {
  service_.AddTree(kDigestA + "-auto");
  service_.AddTree(kDigestA + "-kd-sah");
  service_.AddTree(kDigestB + "-auto");
  EXPECT_EQ(Run({"show", "aaaaaaab"}), kExitOk);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("id        " + kDigestB + "-auto\n"),
                                HasSubstr("health    not closed, 3 open edges\n"),
                                HasSubstr("bounds    -1 -1 -1  to  1 1 1\n")));
  EXPECT_EQ(Run({"show", "aaaaaaaa-kd-sah"}), kExitOk);
  EXPECT_THAT(out_.str(), HasSubstr(kDigestA + "-kd-sah"));
}

TEST_F(CommandTest, AFileNamesTheTreeThatTheServerHasOfItAndIsNotSent) {
  const std::string mesh = WriteMesh();
  EXPECT_EQ(Run({"show", mesh}), kExitUsage);
  EXPECT_THAT(err_.str(), HasSubstr("no tree on"));
  service_.AddTree(IdOf(mesh, "bvh"));
  EXPECT_EQ(Run({"show", mesh}), kExitOk);
  EXPECT_THAT(out_.str(), HasSubstr("id        " + IdOf(mesh, "bvh") + "\n"));
  EXPECT_EQ(Run({"cells", mesh, "--depth", "1"}), kExitOk);
  EXPECT_EQ(Run({"mesh", mesh, "-o", folder_ / "copy.ply"}), kExitOk);
  EXPECT_THAT(service_.Targets("POST"), IsEmpty());
  // To delete, an id is needed: a pattern of the shell may name any file.
  EXPECT_EQ(Run({"delete", mesh}), kExitUsage);
  EXPECT_TRUE(service_.HasTree(IdOf(mesh, "bvh")));
}

TEST_F(CommandTest, AnIdThatNamesSeveralTreesOrNoneIsWrongUsage) {
  service_.AddTree(kDigestA + "-auto");
  service_.AddTree(kDigestB + "-auto");
  EXPECT_EQ(Run({"delete", "aaaaaa"}), kExitUsage);
  EXPECT_THAT(err_.str(), AllOf(HasSubstr("could be any of"), HasSubstr("aaaaaaab0000-auto")));
  EXPECT_THAT(service_.Targets("DELETE"), IsEmpty());
  EXPECT_EQ(Run({"show", "bbbbbb"}), kExitUsage);
  EXPECT_EQ(Run({"show", "abc"}), kExitUsage);  // too short to be meant as an id
  EXPECT_EQ(Run({"show", "../../etc/passwd"}), kExitUsage);
}

TEST_F(CommandTest, DeleteForgetsEveryTreeNamed) {
  service_.AddTree(kDigestA + "-auto");
  service_.AddTree(kDigestB + "-auto");
  EXPECT_EQ(Run({"delete", kDigestA + "-auto", "aaaaaaab"}), kExitOk);
  EXPECT_FALSE(service_.HasTree(kDigestA + "-auto"));
  EXPECT_FALSE(service_.HasTree(kDigestB + "-auto"));
}

TEST_F(CommandTest, CellsPrintsATableOrTheAnswerItself) {
  service_.AddTree(kDigestA + "-auto");
  EXPECT_EQ(Run({"cells", kDigestA + "-auto", "--depth", "1"}), kExitOk);
  EXPECT_EQ(out_.str(),
            "DEPTH  KIND  TRIANGLES  MIN    MAX\n"
            "    1  leaf      4,321  0 0 0  1 2 3\n");
  EXPECT_EQ(service_.Targets("GET").back(), "/v1/trees/" + kDigestA + "-auto/cells?depth=1");
  EXPECT_EQ(Run({"cells", kDigestA + "-auto", "--depth", "1", "--json"}), kExitOk);
  EXPECT_EQ(Document::Parse(out_.str()).value()["cells"].Items().at(0)["triangles"].Count(), 4321u);
}

TEST_F(CommandTest, TradeoffMeasuresWhatWasNotMeasuredAndPrintsATable) {
  const std::string id = kDigestA + "-auto";
  service_.AddTree(id);
  const std::string path = "/v1/trees/" + id + "/tradeoff";
  const std::string measured = R"({"state":"measured","progress":1,"measured_at":"2024-05-17",
      "mesh":{"triangles":12,"closed":true},
      "conditions":{"threads":2,"load_average":0.5,"runs":48,"disturbed_runs":1},
      "results":[{"build":"box","precision":"fast","build_ms":0.5,"bytes":2048,"sah_cost":9.5,
        "random":{"rays_per_s":2500000,"nodes_per_ray":1},"aimed":{"rays_per_s":2000000},
        "leaks":{"count":6,"rays":100,"rate":0.06},
        "wrong_triangles":{"count":0,"rays":100,"rate":0,"below":0.03},
        "missed_hits":{"count":6,"rays":100,"rate":0.06},
        "t_error":{"p999":1e-7,"max":2e-7}}]})";
  service_.AnswerOnce("POST", path, {202, R"({"state":"measuring","progress":0.5})"});
  EXPECT_EQ(Run({"tradeoff", id}), kExitUsage) << "another client stopped it";
  EXPECT_EQ(service_.Targets("POST").back(), path + "?wait_ms=500");
  EXPECT_EQ(service_.Targets("GET").back(), path + "?wait_ms=500");

  service_.AnswerOnce("GET", path, {200, measured});
  EXPECT_EQ(Run({"tradeoff", id}), kExitOk) << err_.str();
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("RANDOM M/S"), HasSubstr("2.5"), HasSubstr("0.06"),
                                HasSubstr("< 0.03"), HasSubstr("12 triangles, closed"),
                                HasSubstr("other work beside 1 of 48 runs")));
  columns_ = 40;
  service_.AnswerOnce("GET", path, {200, measured});
  EXPECT_EQ(Run({"tradeoff", id}), kExitOk);
  std::istringstream lines(out_.str());
  for (std::string text; std::getline(lines, text) && !text.starts_with("12 triangles");) {
    EXPECT_LE(text.size(), 40u) << text;
  }
  columns_ = 0;
  service_.AnswerOnce("GET", path, {200, measured});
  EXPECT_EQ(Run({"tradeoff", id, "--plot", folder_ / "p.png"}), kExitOk);
  EXPECT_THAT(ReadText(folder_ / "p.png"), StartsWith("\x89PNG"));
  EXPECT_EQ(Run({"tradeoff", id, "--plot", "p.svg"}), kExitUsage);
  service_.AnswerOnce("GET", path, {200, measured});
  EXPECT_EQ(Run({"tradeoff", id, "--json"}), kExitOk);
  EXPECT_EQ(Document::Parse(out_.str()).value()["mesh"]["triangles"].Count(), 12u);
  service_.AnswerOnce("POST", path, {200, measured});
  EXPECT_EQ(Run({"tradeoff", id, "--again"}), kExitOk);
  service_.AnswerOnce("DELETE", path, {204, ""});
  EXPECT_EQ(Run({"tradeoff", id, "--forget"}), kExitOk);
}

TEST_F(CommandTest, MeshGivesTheUploadedBytesBack) {
  const std::string mesh = WriteMesh(std::string(100'000, 'x') + "end");
  ASSERT_EQ(Run({"upload", mesh}), kExitOk);
  EXPECT_EQ(Run({"mesh", IdOf(mesh), "-o", folder_ / "back.ply"}), kExitOk);
  EXPECT_EQ(ReadText(folder_ / "back.ply"), ReadText(mesh));
  EXPECT_EQ(Run({"mesh", IdOf(mesh), "-o", folder_ / "back.stl"}), kExitUsage);
  EXPECT_THAT(err_.str(), HasSubstr("must end in .ply"));
  EXPECT_EQ(Run({"mesh", IdOf(mesh), "-o", "-"}), kExitOk);
  EXPECT_EQ(out_.str(), ReadText(mesh));
}

TEST_F(CommandTest, ARefusedMeshDownloadLeavesNoFile) {
  EXPECT_EQ(Run({"mesh", kDigestA + "-auto", "-o", folder_ / "back.ply"}), kExitRefused);
  EXPECT_THAT(err_.str(), HasSubstr("tree_not_found"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "back.ply"));
}

// ---- the server and its absence ----

TEST_F(CommandTest, TheTokenGoesWithEveryRequest) {
  service_.token = "secret";
  EXPECT_EQ(Run({"list"}), kExitRefused);
  EXPECT_THAT(err_.str(), HasSubstr("kdray: unauthorized: a token is needed"));
  EXPECT_EQ(Run({"upload", WriteMesh()}), kExitRefused);
  EXPECT_EQ(Run({"--token", "secret", "upload", WriteMesh()}), kExitOk);
  EXPECT_EQ(Run({"list", "--token", "secret\r\nX-Evil: 1"}), kExitUsage);
}

TEST_F(CommandTest, EveryRequestHasAnIdOfItsOwn) {
  Run({"list"});
  Run({"list"});
  const auto seen = service_.Seen();
  const std::string first = seen.at(0).headers.find("x-request-id")->second;
  EXPECT_THAT(first, StartsWith("kdray-"));
  EXPECT_NE(first, seen.at(1).headers.find("x-request-id")->second);
}

TEST_F(CommandTest, TheTraceOfTheCallerGoesWithEveryRequest) {
  const std::string trace = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
  const auto last = [&] {
    const test::SeenRequest request = service_.Seen().back();
    const auto header = request.headers.find("traceparent");
    return header == request.headers.end() ? "none" : header->second;
  };
  unsetenv("TRACEPARENT");
  Run({"list"});
  EXPECT_EQ(last(), "none");
  EXPECT_EQ(Run({"--traceparent", trace, "list"}), kExitOk);
  EXPECT_EQ(last(), trace);
  EXPECT_EQ(Run({"--traceparent", "00-1-2-3", "list"}), kExitUsage);
  EXPECT_THAT(err_.str(), HasSubstr("the traceparent '00-1-2-3' is invalid"));
  setenv("TRACEPARENT", trace.c_str(), 1);
  EXPECT_EQ(Run({"list"}), kExitOk);
  EXPECT_EQ(last(), trace);
  setenv("TRACEPARENT", "another program's", 1);
  EXPECT_EQ(Run({"list"}), kExitOk) << "an invalid variable is no error";
  EXPECT_EQ(last(), "none");
  unsetenv("TRACEPARENT");
}

TEST_F(CommandTest, SaysThatNobodyListens) {
  std::string url;
  {
    const FakeService gone;
    url = gone.Url();
  }
  EXPECT_EQ(Run({"list", "--server", url}), kExitConnection);
  EXPECT_THAT(err_.str(), AllOf(HasSubstr("cannot connect to " + url), HasSubstr("kdrayd")));
}

TEST_F(CommandTest, AnAnswerThatIsNotOfThisServiceIsRefused) {
  service_.AnswerOnce("GET", "/v1/trees", {200, "<html>hello</html>", "text/html"});
  EXPECT_EQ(Run({"list"}), kExitRefused);
  EXPECT_THAT(err_.str(), HasSubstr("is it a kdray server?"));
  service_.AnswerOnce("GET", "/v1/trees", {502, "<html>bad gateway</html>", "text/html"});
  EXPECT_EQ(Run({"list"}), kExitRefused);
  EXPECT_THAT(err_.str(), HasSubstr("HTTP 502"));
}

// ---- the command line ----

TEST_F(CommandTest, WrongUsageIsToldApart) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {},
           {"uplod"},
           {"upload"},
           {"render", "x"},
           {"list", "--server", "ftp://h"},
           {"sample", "bunny", "-o", "x.ply"},
           {"sample", "cube", "-o", "x.gltf"},
           {"sample", "cube", "-o", "x.ply", "--detail", "0"},
           {"sample-rays", "-n", "5", "-o", "x.ply"},
           {"sample-rays", "-n", "5", "-o", "x.npy", "--bounds", "1,2,3"},
           {"cells", kDigestA + "-auto"},
       }) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    EXPECT_EQ(Run(arguments), kExitUsage);
    EXPECT_THAT(err_.str(), Not(IsEmpty()));
    EXPECT_THAT(out_.str(), IsEmpty());
  }
}

TEST_F(CommandTest, HelpAndVersionGoToStandardOutput) {
  EXPECT_EQ(Run({"--help"}), kExitOk);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("upload"), HasSubstr("Exit codes: 0 success")));
  EXPECT_EQ(Run({"render", "--help"}), kExitOk);
  EXPECT_THAT(out_.str(), HasSubstr("--cells-depth"));
  EXPECT_EQ(Run({"--version"}), kExitOk);
  EXPECT_EQ(out_.str(), "kdray " KDRAY_VERSION "\n");
}

TEST_F(CommandTest, SampleWritesAMeshWithoutAServer) {
  EXPECT_EQ(Run({"sample", "cube", "-o", folder_ / "c.stl"}), kExitOk);
  EXPECT_EQ(std::filesystem::file_size(folder_ / "c.stl"), 84 + 12 * 50);
  EXPECT_THAT(service_.Seen(), IsEmpty());
}

TEST_F(CommandTest, SampleRaysAimsAtTheBoundsOfATree) {
  service_.AddTree(kDigestA + "-auto");
  EXPECT_EQ(Run({"sample-rays", "--tree", kDigestA + "-auto", "-n", "3", "-o", folder_ / "r.npy"}),
            kExitOk);
  const std::string by_bounds = folder_ / "b.npy";
  EXPECT_EQ(Run({"sample-rays", "--bounds=-1,-1,-1,1,1,1", "-n", "3", "-o", by_bounds}), kExitOk);
  EXPECT_EQ(ReadText(folder_ / "r.npy"), ReadText(by_bounds));
}

}  // namespace
}  // namespace kdray::client
