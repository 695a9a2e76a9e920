// SPDX-License-Identifier: Apache-2.0
// Every field of a render request: values, defaults, refusals. render_field_use_test.cc has what
// fields mean for each other.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <string_view>
#include <vector>

#include "api/request_fields.h"
#include "tests/unit/api/render_decoding.h"

namespace kdray::api {
namespace {

using testing::HasSubstr;

struct FieldCase {
  std::string_view name;
  std::string_view missing;  ///< its canonical text when left out; empty: none
  std::vector<std::string_view> good_text, bad_text;
  std::vector<std::string_view> good_json, bad_json;  ///< bad: the right kind, a wrong value
  std::vector<std::string_view> wrong_kind_json;
};

const std::vector<std::string_view> kNotANumber = {"null", "true", "\"1\"", "[1]", "{}"};
const std::vector<std::string_view> kNotText = {"null", "true", "1", "[\"shaded\"]", "{}"};
const std::vector<std::string_view> kNotAVector = {
    "null",  "true",      "1",          "\"1,2,3\"",   "{}",       "[]",
    "[0,0]", "[0,0,0,0]", "[0,0,null]", "[0,0,\"0\"]", "[0,0,[0]]"};

const std::vector<std::string_view> kNotFour = {
    "null", "true", "1", "\"1,2,3,4\"", "{}", "[]", "[1,1,0]", "[1,1,0,0,0]", "[1,1,0,null]"};

const std::vector<FieldCase> kRenderCases = {
    {"width",
     "640",
     {"1", "1048576"},
     {"", "0", "-1", "1048577", "1.5", "1.0", "1e3", "+1", " 1", "1 ", "0x10", "nan", "inf",
      "9223372036854775808", "abc"},
     {"1", "1.0", "1e3", "1048576"},
     {"0", "-1", "1.9", "1048577", "1e18", "1e300", "-1.5", "18446744073709551615",
      "9223372036854775808"},
     kNotANumber},
    {"height",
     "480",
     {"1", "1048576"},
     {"0", "1048577", "x"},
     {"1"},
     {"0", "1048577"},
     kNotANumber},
    {"projection",
     "perspective",
     {"perspective", "orthographic", "spherical"},
     {"", "Perspective", "ortho", "perspective,orthographic"},
     {"\"orthographic\""},
     {"\"\"", "\"Perspective\""},
     kNotText},
    {"eye",
     "",
     {"1,2,3", "-0.5,1e3,0"},
     {"", "1", "1,2", "1,2,3,4", "1,2,", ",1,2", "1,,2", "1,2,x", "nan,0,0", "0,inf,0", "1e999,0,0",
      "[1,2,3]", "1 2 3", "1, 2, 3"},
     {"[1,2,3]", "[-1e300,0.5,0]"},
     {},
     kNotAVector},
    {"target", "", {"1,2,3"}, {"1,2"}, {"[1,2,3]"}, {}, kNotAVector},
    {"up", "", {"0,0,1", "0,1,0"}, {"0,0"}, {"[0,0,1]"}, {}, kNotAVector},
    {"view",
     "",
     {"iso", "front", "back", "left", "right", "top", "bottom"},
     {"", "Front", "front,top", "0"},
     {"\"iso\""},
     {"\"\"", "\"Front\""},
     kNotText},
    {"fov_deg",
     "40",
     {"0.001", "179.999", "4e1"},
     {"", "0", "180", "-1", "181", "nan", "inf", "1e999", "40deg"},
     {"0.001", "179.999"},
     {"0", "180", "-1", "1e300"},
     kNotANumber},
    {"view_height",
     "",
     {"1e-300", "1e300"},
     {"0", "-1", "inf", "nan"},
     {"1e-300", "7"},
     {"0", "-0.0", "-1"},
     kNotANumber},
    {"h_fov_deg",
     "360",
     {"0.001", "360"},
     {"", "0", "-1", "360.001", "nan", "inf"},
     {"0.001", "360"},
     {"0", "360.001"},
     kNotANumber},
    {"v_fov_deg",
     "180",
     {"0.001", "180"},
     {"", "0", "-1", "180.001", "nan", "inf"},
     {"0.001", "180"},
     {"0", "180.001"},
     kNotANumber},
    {"intrinsic",
     "",
     {"500,500,320,240", "1e-3,1e3,-5,0"},
     {"", "500", "500,500,320", "500,500,320,240,1", "500,500,320,nan", "500,500,inf,240"},
     {"[500,500,320,240]"},
     {},
     kNotFour},
    {"extrinsic",
     "",
     {"1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1"},
     {"", "1,0,0,0,0,1,0,0,0,0,1,5,0,0,0", "1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1,0",
      "1,0,0,0,0,1,0,0,0,0,1,nan,0,0,0,1"},
     {"[1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1]"},
     {},
     {"null", "true", "1", "\"1\"", "{}", "[]", "[[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]",
      "[1,0,0,0,0,1,0,0,0,0,1,5,0,0,0]", "[1,0,0,0,0,1,0,0,0,0,1,null,0,0,0,1]"}},
    {"mode",
     "shaded",
     {"shaded", "normal", "depth", "triangle", "ambient-occlusion", "cost"},
     {"", "Shaded", "wireframe", "ambient_occlusion", "position"},
     {"\"depth\""},
     {"\"position\"", "\"x\""},
     kNotText},
    {"depth_range",
     "",
     {"0,1", "-1,1e300", "2,2"},
     {"", "1", "1,2,3", "2,1", "nan,1", "0,inf"},
     {"[0,1]"},
     {"[1,0]"},
     {"null", "true", "1", "\"0,1\"", "{}", "[]", "[1]", "[1,2,3]", "[0,null]"}},
    {"samples",
     "",
     {"1", "1024"},
     {"0", "1025", "1.5"},
     {"1", "1024"},
     {"0", "1025", "1.5"},
     kNotANumber},
    {"precision",
     "auto",
     {"auto", "fast", "watertight", "double", "exact"},
     {"", "Exact", "float"},
     {"\"exact\""},
     {"\"float\""},
     kNotText},
    {"color",
     "0.93,0.88,0.81",
     {"0,0,0", "1,1,1", "0.5,0.25,0", "file"},
     {"-0.1,0,0", "0,1.1,0", "red", "transparent", "File", "file,0,0"},
     {"[0,0,0]", "[1,1,1]", "\"file\""},
     {"[0,0,1.001]", "[-0.001,0,0]"},
     {"null", "true", "1", "{}", "[]", "[0,0]", "[0,0,null]", "\"red\""}},
    {"background",
     "",
     {"0,0,0", "1,1,1", "transparent"},
     {"2,0,0", "Transparent", "none"},
     {"[0,0,0]", "\"transparent\""},
     {"[0,0,2]"},
     {"null", "true", "1", "{}", "[]", "[0,0]", "[0,0,null]"}},
    {"lights",
     "",
     {"[]", R"([{"direction":[0,-1,-1]}])",
      R"([{"position":[1,2,3],"intensity":0,"color":[1,0.5,0]},{"direction":[0,0,1e-300]}])",
      R"(+[+{"intensity":+1e+2+,"position":[1,2,3]}+]+)",
      R"([{"intensity":1E+2,"position":[1,2,3]}])"},
     {"",
      "sun",
      "1,2,3",
      "{}",
      "null",
      "[1]",
      "[[]]",
      "[{}]",
      R"([{"direction":[0,0,0]}])",
      R"([{"direction":[0,0,1],"position":[0,0,1]}])",
      R"([{"direction":[0,0,1],"radius":1}])",
      R"([{"direction":[0,0,1],"intensity":-1}])",
      R"([{"direction":[0,0,1],"color":[1,1,2]}])",
      R"([{"direction":[0,0,1],"direction":[0,0,1]}])",
      R"([{"direction":[0,0,1]}])"
      "x",
      R"([{"direction":[0,0,1e999]}])",
      R"([{"direction":[0,0]}])",
      R"([{"direction":"0,0,1"}])",
      R"([{"position":[0,0,+1]}]])",
      "[[[[[[[[[["},
     {"[]", R"([{"direction":[0,-1,-1]}])", R"([{"position":[1,2,3],"intensity":0.5}])"},
     {"[{}]", R"([{"direction":[0,0,0]}])", R"([{"direction":[0,0,1],"position":[0,0,1]}])",
      R"([{"direction":[0,0,1],"radius":1}])", R"([{"direction":[0,0,1],"intensity":-1}])",
      R"([{"direction":[0,0,1],"color":[1,1,2]}])"},
     {"null", "true", "1", "\"[]\"", "{}", "[1]", "[[]]", "[null]", R"([{"direction":[0,0]}])",
      R"([{"direction":null}])", R"([{"direction":[0,0,1],"intensity":null}])"}},
    {"shadows",
     "false",
     {"true", "false"},
     {"", "1", "True", "yes"},
     {"true", "false"},
     {"\"true\""},
     {"null", "1", "[]", "{}"}},
    {"smooth", "false", {"true", "false"}, {"", "1"}, {"true"}, {"\"true\""}, {"null", "1", "[]"}},
    {"ao_radius",
     "",
     {"1e-300", "1e300"},
     {"", "0", "-1", "inf", "nan"},
     {"1e-300", "7"},
     {"0", "-0.0", "-1"},
     kNotANumber},
    {"edges",
     "false",
     {"true", "false"},
     {"", "1", "yes", "True"},
     {"true", "false"},
     {"\"true\""},
     {"null", "1", "[]", "{}"}},
    {"cells_depth",
     "",
     {"0", "255"},
     {"-1", "256", "1.5"},
     {"0", "255"},
     {"-1", "256", "0.5"},
     kNotANumber},
    {"region",
     "",
     {"0,0,640,480", "639,479,640,480"},
     {"", "0,0,640", "0,0,640,480,0", "0,0,641,480", "0,0,640,481", "5,0,5,1", "6,0,5,1", "0,5,1,5",
      "-1,0,1,1", "0,0,1.5,1"},
     {"[0,0,640,480]"},
     {"[0,0,641,480]", "[0,0,0,0]", "[-1,0,1,1]", "[0,0,1.5,1]"},
     {"null", "true", "1", "\"0,0,1,1\"", "{}", "[]", "[0,0,1]", "[0,0,1,1,1]", "[0,0,1,null]"}},
    {"seed",
     "0",
     {"0", "9007199254740993", "9223372036854775807"},
     {"-1", "9223372036854775808", "1.5"},
     {"0", "9007199254740993", "9223372036854775807"},
     {"-1", "9223372036854775808", "9007199254740993.0", "1e17"},
     kNotANumber},
    {"budget_ms",
     "",
     {"1", "600000"},
     {"", "0", "600001", "-1", "1.5"},
     {"1", "600000"},
     {"0", "600001", "1.5"},
     kNotANumber},
    {"max_noise",
     "",
     {"1e-9", "1", "0.01"},
     {"", "0", "-1", "1.01", "nan", "inf"},
     {"1e-9", "1"},
     {"0", "-0.0", "1.01"},
     kNotANumber},
    {"max_samples",
     "1024",
     {"1", "1024"},
     {"", "0", "1025", "1.5"},
     {"1", "1024"},
     {"0", "1025", "1.5"},
     kNotANumber},
    {"deadline_ms",
     "",
     {"1", "600000"},
     {"0", "600001", "-1", "1.5"},
     {"1", "600000"},
     {"0", "600001"},
     kNotANumber},
};

std::string Named(const FieldCase& c, std::string_view text) {
  return std::string(c.name) + "=" + std::string(text);
}
std::string JsonNamed(const FieldCase& c, std::string_view json) {
  return "{\"" + std::string(c.name) + "\":" + std::string(json) + "}";
}

TEST(RenderFields, AreAllInThisTest) {
  std::vector<std::string_view> tested, fields;
  for (const FieldCase& c : kRenderCases) tested.push_back(c.name);
  for (const auto& field : RenderFields(kLimits).fields) fields.push_back(field.name);
  EXPECT_EQ(tested, fields);
}

TEST(RenderFields, KeepTheirDefaultWhenLeftOut) {
  std::string canonical;
  for (const FieldCase& c : kRenderCases) {
    if (c.missing.empty()) continue;
    canonical += (canonical.empty() ? "" : "&") + Named(c, c.missing);
  }
  EXPECT_EQ(CanonicalQuery(*Query("")), canonical);
  EXPECT_EQ(CanonicalQuery(*Body("{}")), canonical);
  EXPECT_EQ(CanonicalQuery(RenderRequest{}), canonical);
}

/// The projection or mode that a field needs; empty for the default one.
std::string NeedsOf(std::string_view field) {
  if (field == "view_height") return "projection=orthographic";
  if (field == "depth_range") return "mode=depth";
  if (field == "ao_radius") return "mode=ambient-occlusion";
  return field == "h_fov_deg" || field == "v_fov_deg" ? "projection=spherical" : "";
}

TEST(RenderFields, TakeEveryValueUpToTheirLimits) {
  for (const FieldCase& c : kRenderCases) {
    // The image must be small enough for the limits, and the projection the one of the field.
    const std::string small = c.name == "width"    ? "&height=1&region=0,0,1,1"
                              : c.name == "height" ? "&width=1&region=0,0,1,1"
                                                   : "";
    const std::string needs = NeedsOf(c.name);
    for (const std::string_view text : c.good_text) {
      const auto request = Query(Named(c, text) + small + (needs.empty() ? "" : "&" + needs));
      EXPECT_TRUE(request) << Named(c, text) << ": " << request.problem().detail;
    }
    for (const std::string_view json : c.good_json) {
      std::string body = JsonNamed(c, json);
      if (!small.empty()) body.insert(1, "\"region\":[0,0,1,1],");
      if (const std::size_t equals = needs.find('='); equals != std::string::npos) {
        body.insert(1, "\"" + needs.substr(0, equals) + "\":\"" + needs.substr(equals + 1) + "\",");
      }
      const auto request = Body(body);
      EXPECT_TRUE(request) << body << ": " << request.problem().detail;
    }
  }
}

TEST(RenderFields, RefuseOtherParametersByName) {
  for (const FieldCase& c : kRenderCases) {
    for (const std::string_view text : c.bad_text) {
      const auto request = Query(Named(c, text));
      ASSERT_FALSE(request) << Named(c, text);
      EXPECT_EQ(request.problem().code, ErrorCode::kInvalidParameter) << Named(c, text);
      EXPECT_EQ(request.problem().parameter, c.name) << Named(c, text);
      EXPECT_THAT(request.problem().detail, HasSubstr(c.name)) << Named(c, text);
    }
  }
}

TEST(RenderFields, RefuseOtherJsonValuesByPointer) {
  for (const FieldCase& c : kRenderCases) {
    const auto expect_refusal = [&](std::string_view json, ErrorCode code) {
      const auto request = Body("\n" + JsonNamed(c, json));
      ASSERT_FALSE(request) << JsonNamed(c, json);
      EXPECT_EQ(request.problem().code, code) << JsonNamed(c, json);
      EXPECT_THAT(*request.problem().parameter, testing::StartsWith("/" + std::string(c.name)))
          << JsonNamed(c, json);
    };
    for (const auto json : c.bad_json) expect_refusal(json, ErrorCode::kInvalidParameter);
    for (const auto json : c.wrong_kind_json) expect_refusal(json, ErrorCode::kInvalidJson);
    expect_refusal("1e999", ErrorCode::kInvalidJson);
  }
}

TEST(RenderFields, RefuseToComeTwice) {
  for (const FieldCase& c : kRenderCases) {
    const std::string text = Named(c, c.good_text[0]);
    const auto query = Query(text + "&" + text);
    ASSERT_FALSE(query) << text;
    EXPECT_EQ(query.problem().code, ErrorCode::kInvalidParameter);
    EXPECT_EQ(query.problem().parameter, c.name);
    EXPECT_THAT(query.problem().detail, HasSubstr("twice"));

    const std::string member = "\"" + std::string(c.name) + "\":" + std::string(c.good_json[0]);
    const auto body = Body("{" + member + "," + member + "}");
    ASSERT_FALSE(body) << member;
    EXPECT_EQ(body.problem().code, ErrorCode::kInvalidJson);
    EXPECT_EQ(body.problem().parameter, "/" + std::string(c.name));
    EXPECT_THAT(body.problem().detail, HasSubstr("repeated"));
  }
}

}  // namespace
}  // namespace kdray::api
