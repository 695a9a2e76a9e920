// SPDX-License-Identifier: Apache-2.0
// `kdray` as a whole, in this process, against the fake service.
#include "clients/cpp/command/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <iterator>
#include <sstream>

#include "kdray/document.h"
#include "kdray/payload.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/clients/fake_service.h"

namespace kdray::client {
namespace {

using test::FakeService;
using test::ProblemJson;
using test::ReadText;
using test::TemporaryFolder;
using test::WriteText;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

const std::string kDigestA(64, 'a');
const std::string kDigestB = "aaaaaaab" + std::string(56, '0');

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
    WriteText(folder_ / "mesh.ply", bytes);
    return folder_ / "mesh.ply";
  }

  std::string IdOf(const std::string& path, const std::string& build = "auto") {
    return Payload::OfFile(path).Sha256() + "-" + build;
  }

  FakeService service_;
  TemporaryFolder folder_;
  std::ostringstream out_;
  std::ostringstream err_;
  std::size_t columns_ = 0;
};

// ---- upload ----

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

// ---- render and rays ----

TEST_F(CommandTest, RenderPassesEveryFieldOnAndWritesThePicture) {
  service_.AddTree(kDigestA + "-auto");
  const std::string picture = folder_ / "a.png";
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", picture, "--width", "800", "--eye", "-1,2,-3",
                 "--fov-deg", "30", "--mode", "depth", "--cells-depth", "0"}),
            kExitOk);
  EXPECT_EQ(ReadText(picture), "picture as png");
  EXPECT_THAT(service_.Targets("GET"),
              ElementsAre("/v1/trees/" + kDigestA +
                          "-auto/render.png?width=800&mode=depth&eye=-1,2,-3&fov_deg=30&"
                          "cells_depth=0"));
  EXPECT_THAT(err_.str(), HasSubstr("watertight precision, traced in 23.5 ms"));
}

TEST_F(CommandTest, RenderKnowsTheFormatByTheEnding) {
  service_.AddTree(kDigestA + "-auto");
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", folder_ / "a.npy"}), kExitOk);
  EXPECT_EQ(ReadText(folder_ / "a.npy"), "picture as npy");
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", folder_ / "a.jpg"}), kExitUsage);
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", "-"}), kExitOk);
  EXPECT_EQ(out_.str(), "picture as png");
}

TEST_F(CommandTest, RenderOfAFileUploadsItFirst) {
  const std::string mesh = WriteMesh();
  EXPECT_EQ(Run({"render", mesh, "-o", folder_ / "a.png"}), kExitOk);
  EXPECT_TRUE(service_.HasTree(IdOf(mesh)));
  EXPECT_EQ(service_.Targets("GET").back(), "/v1/trees/" + IdOf(mesh) + "/render.png");
}

TEST_F(CommandTest, ARefusedRenderLeavesTheOldPicture) {
  WriteText(folder_ / "a.png", "old");
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", folder_ / "a.png"}), kExitRefused);
  EXPECT_THAT(err_.str(), StartsWith("kdray: tree_not_found: "));
  EXPECT_EQ(ReadText(folder_ / "a.png"), "old");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
}

TEST_F(CommandTest, RaysSendsTheArrayAsItIsAndWritesTheAnswer) {
  service_.AddTree(kDigestA + "-auto");
  const std::string rays = folder_ / "rays.npy";
  ASSERT_EQ(Run({"sample-rays", "--bounds", "-1,-1,-1,1,1,1", "-n", "10", "-o", rays}), kExitOk);
  EXPECT_EQ(Run({"rays", kDigestA + "-auto", rays, "-o", folder_ / "hits.npy", "--fields",
                 "t,point", "--t-min", "1e-6"}),
            kExitOk);
  EXPECT_EQ(ReadText(folder_ / "hits.npy"), "hits for " + ReadText(rays));
  const auto request = service_.Seen().back();
  EXPECT_EQ(request.target,
            "/v1/trees/" + kDigestA + "-auto/rays/closest?fields=t,point&t_min=1e-6");
  EXPECT_EQ(request.headers.find("accept")->second, "application/x-npy");
  EXPECT_THAT(err_.str(), HasSubstr("10 rays, 3 invalid rows"));
}

TEST_F(CommandTest, RaysAsksForAnyHitAndForJsonWhenTold) {
  service_.AddTree(kDigestA + "-auto");
  WriteText(folder_ / "rays.json", R"( {"rays": [[0,0,5,0,0,-1]]})");
  EXPECT_EQ(Run({"rays", kDigestA + "-auto", folder_ / "rays.json", "--any", "-o",
                 folder_ / "hits.json"}),
            kExitOk);
  const auto request = service_.Seen().back();
  EXPECT_EQ(request.target, "/v1/trees/" + kDigestA + "-auto/rays/any");
  EXPECT_EQ(request.headers.find("accept")->second, "application/json");
}

TEST_F(CommandTest, AWrongWordNamesItselfAndTheNearestRightOne) {
  service_.AddTree(kDigestA + "-auto");
  const std::string tree = kDigestA + "-auto";
  const struct {
    std::vector<std::string> arguments;
    std::string says;
  } kCases[] = {
      {{"uplaod", "x"}, "kdray: there is no command 'uplaod'; did you mean 'upload'?"},
      {{"frobnicate"}, "kdray: there is no command 'frobnicate'\n"},
      {{"render", tree, "-o", "a.png", "--widht", "5"},
       "kdray render has no option '--widht'; did you mean '--width'?"},
      {{"list", "-x"}, "kdray list has no option '-x'"},
      {{"--sever", "x", "list"}, "kdray has no option '--sever'; did you mean '--server'?"},
      {{"sample", "teaport", "-o", "-"}, "there is no name 'teaport'; did you mean 'teapot'?"},
      {{"completion", "bsh"}, "there is no shell 'bsh'; did you mean 'bash'?"},
      {{"render", tree, "-o", "a.jpg"}, "'a.jpg' must end in .png or .npy"},
      {{"render", tree, "-o", "a.png", "--size", "640*480"}, "as 1920x1080, not '640*480'"},
  };
  for (const auto& test : kCases) {
    SCOPED_TRACE(::testing::PrintToString(test.arguments));
    EXPECT_EQ(Run(test.arguments), kExitUsage);
    EXPECT_THAT(err_.str(), HasSubstr(test.says));
  }
  service_.AnswerOnce(
      "GET", "/v1/trees/" + tree + "/render",
      {400, ProblemJson(400, "invalid_parameter", "no mode 'shadde'", R"({"parameter": "mode"})"),
       "application/problem+json"});
  EXPECT_EQ(Run({"render", tree, "-o", folder_ / "a.png", "--mode", "shadde"}), kExitRefused);
  EXPECT_THAT(err_.str(), HasSubstr("did you mean 'shaded'?"));
}

TEST_F(CommandTest, SizeIsWidthAndHeight) {
  service_.AddTree(kDigestA + "-auto");
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", folder_ / "a.png", "--size", "80x60"}),
            kExitOk);
  EXPECT_THAT(service_.Targets("GET").back(), HasSubstr("render.png?width=80&height=60"));
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", folder_ / "a.png", "--size", "80x60",
                 "--width", "5"}),
            kExitUsage);
}

TEST_F(CommandTest, TurntableGoesOnceAroundTheMesh) {
  const std::string tree = kDigestA + "-auto";
  service_.AddTree(tree);
  EXPECT_EQ(Run({"render", tree, "-o", folder_ / "t.png", "--turntable", "4", "--view", "front"}),
            kExitOk);
  std::vector<std::string> eyes;
  for (const std::string& target : service_.Targets("GET")) {
    const std::size_t eye = target.find("eye=");
    if (eye != std::string::npos) eyes.push_back(target.substr(eye + 4));
  }
  ASSERT_EQ(eyes.size(), 4u);
  EXPECT_THAT(eyes[0], StartsWith("0,0,"));  // the front, then the right side, and so on
  for (const char* name : {"t-0.png", "t-1.png", "t-2.png", "t-3.png"}) {
    EXPECT_EQ(ReadText(folder_ / name), "picture as png") << name;
  }
  EXPECT_THAT(err_.str(), HasSubstr("t-0.png to "));
  EXPECT_EQ(Run({"render", tree, "-o", "-", "--turntable", "2"}), kExitOk);
  EXPECT_EQ(out_.str(), "picture as pngpicture as png");
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{"--view", "top"},
                                             {"--projection", "spherical"},
                                             {"--up", "0,0,0"},
                                             {"--up", "up"},
                                             {"--eye", "0,9,0"}}) {
    std::vector<std::string> arguments = {"render", tree, "-o", "-", "--turntable", "2"};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    EXPECT_EQ(Run(arguments), kExitUsage) << wrong.front();
  }
}

TEST_F(CommandTest, JsonTellsWhatWasWritten) {
  service_.AddTree(kDigestA + "-auto");
  const std::string picture = folder_ / "a.png";
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", picture, "--json"}), kExitOk);
  const Document told = Document::Parse(out_.str()).value();
  EXPECT_EQ(told["file"].Text(), picture);
  EXPECT_EQ(told["bytes"].Count(), 14u);
  EXPECT_EQ(told["precision"].Text(), "watertight");
  EXPECT_EQ(told["trace_ms"].Number(), 23.5);
  EXPECT_EQ(Run({"render", kDigestA + "-auto", "-o", "-", "--json"}), kExitUsage);
  EXPECT_THAT(err_.str(), HasSubstr("both write to standard output"));
}

TEST_F(CommandTest, RaysRefusesAnotherArrayBeforeItTravels) {
  service_.AddTree(kDigestA + "-auto");
  const auto npy = [](const std::string& header) {
    return std::string("\x93NUMPY\1\0", 8) + static_cast<char>(header.size()) + '\0' + header;
  };
  const struct {
    std::string bytes;
    const char* reason;
  } kCases[] = {
      {npy("{'descr': '<i4', 'fortran_order': False, 'shape': (2, 6), }\n"), "<i4"},
      {npy("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }\n"), "3"},
      {npy("{'descr': '<f4', 'fortran_order': False, 'shape': (), }\n"), "columns"},
      {npy("{'descr': '<f4', "), "too early"},
      {npy("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6), }\n"), "12 numbers"},
      {npy("{'descr': '<f8', 'fortran_order': False, 'shape': (9223372036854775807, 6), }\n"),
       "more than 2^64 numbers"},
      {"0 0 5 0 0 -1\n", "neither"},
      {"", "neither"},
  };
  for (const auto& test : kCases) {
    SCOPED_TRACE(test.bytes);
    WriteText(folder_ / "rays.npy", test.bytes);
    EXPECT_EQ(Run({"rays", kDigestA + "-auto", folder_ / "rays.npy", "-o", folder_ / "h.npy"}),
              kExitLocalFile);
    EXPECT_THAT(err_.str(), AllOf(HasSubstr("rays.npy: "), HasSubstr(test.reason)));
  }
  EXPECT_THAT(service_.Seen(), IsEmpty());
}

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
