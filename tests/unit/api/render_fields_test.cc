// SPDX-License-Identifier: Apache-2.0
// Every field of a render request: values, defaults, refusals, and the modes that use it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "api/names.h"
#include "api/request_codec.h"
#include "api/request_fields.h"
#include "tests/support/seed.h"

namespace kdray::api {
namespace {

using testing::HasSubstr;

const Limits kLimits;

Outcome<RenderRequest> Query(std::string_view query) {
  return DecodeRenderQuery(query, ImageForm::kPng, kLimits);
}
Outcome<RenderRequest> Body(std::string_view body) {
  return DecodeRenderBody(body, ImageForm::kPng, "application/json", kLimits);
}

// ---- Every render field, as parameter and in JSON ----

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

// ---- Random requests there and back ----

/// A value that `kind` takes.
FieldValue RandomValue(const FieldKind& kind, std::mt19937_64& random) {
  const auto integer = [&](std::int64_t min, std::int64_t max) {
    return std::uniform_int_distribution<std::int64_t>(min, max)(random);
  };
  const auto number = [&](double min, double max) {
    const double wide = std::ldexp(std::uniform_real_distribution<double>(-1, 1)(random),
                                   static_cast<int>(integer(-300, 300)));
    const double inside = std::clamp(wide, min, max);
    return inside == min || inside == max ? 0.25 : inside;
  };
  if (const auto* k = std::get_if<IntegerKind>(&kind)) return integer(k->min, k->max);
  if (const auto* k = std::get_if<NumberKind>(&kind)) return number(k->min, k->max);
  if (const auto* k = std::get_if<VectorKind>(&kind)) {
    if (!k->word.empty() && integer(0, 1)) return std::string(k->word);
    std::vector<double> numbers(k->count);
    for (double& n : numbers) n = number(k->min, k->max);
    return numbers;
  }
  if (const auto* k = std::get_if<ChoiceKind>(&kind)) {
    return integer(0, static_cast<std::int64_t>(k->names.size()) - 1);
  }
  if (std::holds_alternative<BooleanKind>(kind)) return integer(0, 1) == 1;
  if (std::holds_alternative<LightsKind>(kind)) {
    std::vector<Light> lights(static_cast<std::size_t>(integer(0, 3)));
    for (Light& light : lights) {
      const Vec3 vector = {number(-1e300, 1e300), number(-1, 1), number(-1, 1)};
      (integer(0, 1) == 1 ? light.direction : light.position) = vector;
      if (integer(0, 1) == 1) light.intensity = number(0, 1e300);
      if (integer(0, 1) == 1) light.color = {number(0, 1), number(0, 1), number(0, 1)};
    }
    return lights;
  }
  return std::vector<std::int64_t>{0, 0, 1, 1};  // the region
}

/// A parameter's text as the JSON value that means the same.
std::string AsJson(const FieldKind& kind, const std::string& text) {
  if (std::holds_alternative<ChoiceKind>(kind) || text == "transparent" || text == "file") {
    return '"' + text + '"';
  }
  const bool list =
      std::holds_alternative<VectorKind>(kind) || std::holds_alternative<IntegersKind>(kind);
  return list ? '[' + text + ']' : text;
}

// ---- Fields that belong to a projection, a mode or a form ----

struct Belonging {
  std::string_view field, text, default_text;               ///< default: empty without one
  std::vector<std::string_view> projections, modes, forms;  ///< empty: all
};

const std::vector<std::string_view> kSampledModes = {"shaded", "normal", "ambient-occlusion"};
const std::vector<Belonging> kBelongings = {
    {"fov_deg", "50", "40", {"perspective"}, {}, {}},
    {"view_height", "2", "", {"orthographic"}, {}, {}},
    {"h_fov_deg", "90", "360", {"spherical"}, {}, {}},
    {"v_fov_deg", "90", "180", {"spherical"}, {}, {}},
    {"intrinsic", "500,500,320,240", "", {"perspective"}, {}, {}},
    {"extrinsic", "1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1", "", {"perspective"}, {}, {}},
    {"cells_depth", "3", "", {"perspective", "orthographic"}, {}, {}},
    {"depth_range", "1,2", "", {}, {"depth"}, {"render.png"}},
    {"samples", "4", "1", {}, kSampledModes, {}},
    {"seed", "3", "0", {}, kSampledModes, {}},
    {"max_samples", "64", "1024", {}, kSampledModes, {}},
    {"max_noise", "0.1", "", {}, kSampledModes, {}},
    {"budget_ms", "50", "", {}, kSampledModes, {}},
    {"color", "1,0,0", "0.93,0.88,0.81", {}, {"shaded"}, {}},
    {"lights", R"([{"direction":[0,0,1]}])", "", {}, {"shaded"}, {}},
    {"shadows", "true", "false", {}, {"shaded"}, {}},
    {"color", "file", "0.93,0.88,0.81", {}, {"shaded"}, {}},
    {"smooth", "true", "false", {}, {"shaded"}, {}},
    {"ao_radius", "2", "", {}, {"ambient-occlusion"}, {}},
    {"background", "transparent", "", {}, {}, {"render.png"}},
    {"background", "0.5,0.5,0.5", "", {}, {}, {"render.png"}},
};

bool Holds(const std::vector<std::string_view>& names, std::string_view name) {
  return names.empty() || std::find(names.begin(), names.end(), name) != names.end();
}

bool IsUsed(std::string_view field, const RenderRequest& request) {
  // Replaced by fields that come before them in the table, or replacing them.
  if (field == "view" && request.eye) return false;
  if (field == "intrinsic" && request.fov_deg != 40) return false;
  const bool has_view = request.eye || request.target || request.up || request.view;
  if (field == "extrinsic" && has_view) return false;
  return std::all_of(kBelongings.begin(), kBelongings.end(), [&](const Belonging& b) {
    return b.field != field ||
           (Holds(b.projections, Name(request.projection)) && Holds(b.modes, Name(request.mode)));
  });
}

TEST(UnusedFields, AreRefusedByNameUnlessTheyHaveTheirDefault) {
  for (const std::string_view projection : kProjectionNames) {
    for (const std::string_view mode : kRenderModeNames) {
      if (mode == "position") continue;  // has no picture
      const std::string kind =
          "projection=" + std::string(projection) + "&mode=" + std::string(mode);
      const std::string json = "{\"projection\":\"" + std::string(projection) + "\",\"mode\":\"" +
                               std::string(mode) + "\",";
      for (const auto& [form, form_name] :
           {std::pair(ImageForm::kPng, "render.png"), {ImageForm::kNpy, "render.npy"}}) {
        for (const Belonging& b : kBelongings) {
          const std::string name(b.field), text(b.text);
          const auto query = [&](std::string_view value) {
            return DecodeRenderQuery(kind + "&" + name + "=" + std::string(value), form, kLimits);
          };
          const bool is_list = text.find(',') != std::string::npos && text[0] != '[';
          const std::string value = is_list                                   ? "[" + text + "]"
                                    : text == "transparent" || text == "file" ? '"' + text + '"'
                                                                              : text;
          const auto body = DecodeRenderBody(json + "\"" + name + "\":" + value + "}", form,
                                             std::nullopt, kLimits);
          if (b.field == "cells_depth" && form == ImageForm::kNpy && mode != "shaded") continue;
          const bool is_used =
              Holds(b.projections, projection) && Holds(b.modes, mode) && Holds(b.forms, form_name);
          SCOPED_TRACE(kind + " " + form_name + " " + name + "=" + text);
          ASSERT_EQ(query(text).ok(), is_used);
          ASSERT_EQ(body.ok(), is_used);
          ASSERT_TRUE(b.default_text.empty() || query(b.default_text));
          if (is_used) continue;
          EXPECT_EQ(query(text).problem().code, ErrorCode::kInvalidParameter);
          EXPECT_EQ(query(text).problem().parameter, name);
          EXPECT_EQ(body.problem().code, ErrorCode::kInvalidParameter);
          EXPECT_EQ(body.problem().parameter, "/" + name);
          const auto& owners = !Holds(b.projections, projection) ? b.projections
                               : !Holds(b.modes, mode)           ? b.modes
                                                                 : b.forms;
          for (const std::string_view owner : owners) {
            EXPECT_THAT(query(text).problem().detail, HasSubstr(owner));
          }
        }
      }
    }
  }
}

TEST(UnusedFields, AreLinesInArraysOtherThanShaded) {
  for (const std::string_view mode : kRenderModeNames) {
    for (const std::string_view lines : {"edges=true", "cells_depth=3"}) {
      const std::string query = "mode=" + std::string(mode) + "&" + std::string(lines);
      SCOPED_TRACE(query);
      const auto array = DecodeRenderQuery(query, ImageForm::kNpy, kLimits);
      EXPECT_EQ(array.ok(), mode == "shaded");
      EXPECT_TRUE(mode == "position" || DecodeRenderQuery(query, ImageForm::kPng, kLimits).ok());
      if (array) continue;
      EXPECT_EQ(array.problem().parameter, lines.substr(0, lines.find('=')));
      EXPECT_THAT(array.problem().detail,
                  HasSubstr("belongs to render.png and to arrays of mode shaded, not to arrays of "
                            "mode " +
                            std::string(mode)));
    }
  }
}

TEST(UnusedFields, MayHoldTheBackgroundThatTheModeHas) {
  for (const std::string mode :
       {"shaded", "normal", "depth", "triangle", "ambient-occlusion", "cost", "position"}) {
    const bool white = mode == "shaded" || mode == "ambient-occlusion";
    const auto npy = [&](const char* background) {
      return DecodeRenderQuery("mode=" + mode + "&background=" + background, ImageForm::kNpy,
                               kLimits);
    };
    EXPECT_EQ(npy("1,1,1").ok(), white) << mode;
    EXPECT_EQ(npy("0,0,0").ok(), !white) << mode;
  }
}

TEST(UnusedFields, AreKnownFieldsEachOfThem) {
  const FieldTable<RenderRequest> table = RenderFields(kLimits);
  for (const Belonging& b : kBelongings) EXPECT_NE(FindField(table, b.field), nullptr) << b.field;
}

TEST(Lights, AreRefusedByPointer) {
  const auto pointer_in = [](std::string_view lights) {
    const auto body = Body("{\"lights\":" + std::string(lights) + "}");
    const auto query = Query("lights=" + std::string(lights));
    EXPECT_EQ(query.problem().code, ErrorCode::kInvalidParameter);
    EXPECT_EQ(query.problem().parameter, "lights");
    EXPECT_THAT(query.problem().detail, HasSubstr(*body.problem().parameter));
    EXPECT_THAT(body.problem().detail, HasSubstr(*body.problem().parameter));
    return *body.problem().parameter;
  };
  EXPECT_EQ(pointer_in(R"([{"direction":[0,0,0]}])"), "/lights/0/direction");
  EXPECT_EQ(pointer_in(R"([{"direction":[0,0,1]},{"position":[0,0]}])"), "/lights/1/position");
  EXPECT_EQ(pointer_in(R"([{"position":[0,0,"1"]}])"), "/lights/0/position/2");
  EXPECT_EQ(pointer_in(R"([{"position":[0,0,1],"intensity":-1}])"), "/lights/0/intensity");
  EXPECT_EQ(pointer_in(R"([{"position":[0,0,1],"colour":[0,0,1]}])"), "/lights/0/colour");
  EXPECT_EQ(pointer_in(R"([{"intensity":1}])"), "/lights/0");
  EXPECT_EQ(pointer_in("[7]"), "/lights/0");
}

TEST(Lights, AreAtMostSixtyFour) {
  std::string lights = R"([{"direction":[0,0,1]})";
  for (std::size_t i = 1; i < kMaxLights; ++i) lights += R"(,{"direction":[0,0,1]})";
  EXPECT_TRUE(Query("lights=" + lights + "]"));
  EXPECT_TRUE(Body("{\"lights\":" + lights + "]}"));
  lights += R"(,{"direction":[0,0,1]}])";
  EXPECT_EQ(Query("lights=" + lights).problem().limit, 64);
  EXPECT_EQ(Body("{\"lights\":" + lights + "}").problem().actual, 65);
}

TEST(RenderFields, OfPositionBelongToArrays) {
  EXPECT_TRUE(DecodeRenderQuery("mode=position", ImageForm::kNpy, kLimits));
  const auto png = Query("mode=position");
  ASSERT_FALSE(png);
  EXPECT_EQ(png.problem().code, ErrorCode::kInvalidParameter);
  EXPECT_EQ(png.problem().parameter, "mode");
  for (const std::string field : {"samples=2", "seed=1", "max_samples=5", "max_noise=0.1",
                                  "budget_ms=9", "color=0,0,0", "background=1,1,1"}) {
    EXPECT_FALSE(DecodeRenderQuery("mode=position&" + field, ImageForm::kNpy, kLimits)) << field;
  }
}

TEST(DepthRange, IsRequiredForARegionOfAnImageAboveTheLimit) {
  Limits limits;
  limits.max_pixels = 10'000;
  const auto decode = [&](const std::string& query, ImageForm form = ImageForm::kPng) {
    return DecodeRenderQuery("mode=depth&" + query, form, limits);
  };
  const std::string large = "width=1000&height=11&region=0,0,10,10";
  EXPECT_TRUE(decode("width=1000&height=10&region=0,0,10,10"));
  EXPECT_TRUE(decode(large, ImageForm::kNpy));
  EXPECT_TRUE(decode(large + "&depth_range=1,2"));
  const auto refused = decode(large);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.problem().code, ErrorCode::kInvalidParameter);
  EXPECT_EQ(refused.problem().parameter, "depth_range");
  EXPECT_EQ(refused.problem().limit, 10'000);
  EXPECT_EQ(refused.problem().actual, 11'000);
  EXPECT_EQ(decode("width=1000&height=11").problem().code, ErrorCode::kImageTooLarge);
}

TEST(Regions, MayBeOfImagesAboveTheLargestSide) {
  EXPECT_TRUE(Query("width=20000&height=20&region=0,0,64,20"));
  EXPECT_TRUE(Query("width=1048576&height=1048576&region=1048512,1048556,1048576,1048576"));
  EXPECT_EQ(Query("width=20000&height=20").problem().code, ErrorCode::kImageTooLarge);
  EXPECT_EQ(Query("width=20000&height=20&region=0,0,16385,20").problem().code,
            ErrorCode::kImageTooLarge);
}

TEST(ReplacedFields, AreRefusedByNameUnlessTheyHaveTheirDefault) {
  const std::string extrinsic = "extrinsic=1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1";
  const std::string intrinsic = "intrinsic=500,500,320,240";
  struct Case {
    std::string field, replaced;
    bool is_accepted = false;
  };
  const std::vector<Case> cases = {
      {extrinsic, "eye=1,2,3"},        {extrinsic, "target=1,2,3"},
      {extrinsic, "up=0,0,1"},         {extrinsic, "up=0,1,0", true},
      {extrinsic, "view=front"},       {extrinsic, "fov_deg=30", true},
      {"eye=1,2,3", "view=front"},     {intrinsic, "fov_deg=30"},
      {intrinsic, "fov_deg=40", true}, {intrinsic, extrinsic, true},
      {intrinsic, "view=top", true},   {"target=1,2,3", "view=iso", true},
      {"up=0,0,1", "view=top", true},
  };
  for (const Case& c : cases) {
    for (const auto& request :
         {Query(c.field + "&" + c.replaced), Query(c.replaced + "&" + c.field)}) {
      SCOPED_TRACE(c.field + " " + c.replaced);
      ASSERT_EQ(request.ok(), c.is_accepted);
      if (c.is_accepted) continue;
      EXPECT_EQ(request.problem().code, ErrorCode::kInvalidParameter);
      EXPECT_EQ(request.problem().parameter, c.replaced.substr(0, c.replaced.find('=')));
      EXPECT_THAT(request.problem().detail, HasSubstr(c.field.substr(0, c.field.find('='))));
    }
  }
  const auto body = Body(R"({"eye": [1,2,3], "view": "front"})");
  ASSERT_FALSE(body);
  EXPECT_EQ(body.problem().parameter, "/view");
}

/// The mode that has no picture.
constexpr auto kPosition = static_cast<std::int64_t>(RenderMode::kPosition);

TEST(RenderRequests, MeanTheSameAsParametersInAnyOrderAndInJson) {
  auto random = test::RandomEngine(1101);
  const FieldTable<RenderRequest> table = RenderFields(kLimits);
  for (int round = 0; round < 2000; ++round) {
    RenderRequest request;
    std::vector<std::string> pieces;
    std::string json = "{";
    for (const Field<RenderRequest>& field : table.fields) {
      if (random() % 2 || !IsUsed(field.name, request)) continue;
      // Refused together with samples.
      const bool decides = field.name == "budget_ms" || field.name == "max_noise";
      if (decides && request.samples.value_or(1) > 1) continue;
      // Whole images of random sides would mostly be too large.
      const bool side = field.name == "width" || field.name == "height";
      const FieldKind kind = side ? IntegerKind{1, 4096} : field.kind;
      FieldValue value = RandomValue(kind, random);
      if (field.name == "mode" && value == FieldValue(kPosition)) continue;
      if (field.name == "depth_range") {
        auto& range = std::get<std::vector<double>>(value);
        std::sort(range.begin(), range.end());
      }
      field.set(request, value);
      const std::string text = WriteText(kind, value);
      pieces.push_back(std::string(field.name) + '=' + text);
      json +=
          (json.size() > 1 ? ",\"" : "\"") + std::string(field.name) + "\": " + AsJson(kind, text);
    }
    std::shuffle(pieces.begin(), pieces.end(), random);
    std::string query;
    for (const std::string& piece : pieces) query += (query.empty() ? "" : "&") + piece;
    const auto from_query = Query(query), from_json = Body(json + '}');
    ASSERT_TRUE(from_query) << query << ": " << from_query.problem().detail;
    ASSERT_TRUE(from_json) << json << "}: " << from_json.problem().detail;
    EXPECT_EQ(CanonicalQuery(*from_query), CanonicalQuery(request)) << query;
    EXPECT_EQ(CanonicalQuery(*from_json), CanonicalQuery(request)) << json;
    EXPECT_EQ(from_query->deadline_ms, request.deadline_ms);
    EXPECT_EQ(from_json->deadline_ms, request.deadline_ms);
  }
}

// ---- What no field sees alone ----

}  // namespace
}  // namespace kdray::api
