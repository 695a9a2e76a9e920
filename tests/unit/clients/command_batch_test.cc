// SPDX-License-Identifier: Apache-2.0
// `kdray render` and `kdray rays` against the fake service.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "kdray/document.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/clients/command_fixture.h"

namespace kdray::client {
namespace {

using test::ProblemJson;
using test::ReadText;
using test::WriteText;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

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
  EXPECT_THAT(err_.str(), HasSubstr("hits.json: 3 invalid rows")) << "rows of JSON are not counted";
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
      {{"render", tree, "-o", "a.png", "--samples", ""}, "--samples: the value is empty"},
      {{"render", tree, "-o", "a.png", "--samples="}, "--samples: the value is empty"},
      {{"render", tree, "-o", ""}, "-o: the value is empty"},
      {{"upload", "x", "--build", ""}, "--build: the value is empty"},
      {{"render", tree, "-o", "a.png", "--shadows", "--size", "8x8"},
       "--shadows needs a value, and '--size' follows it"},
      {{"delete", "a.obj"}, "'a.obj' is not a tree id"},
      {{"show", "a.obj"}, "'a.obj' is neither a file here nor a tree id"},
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

}  // namespace
}  // namespace kdray::client
