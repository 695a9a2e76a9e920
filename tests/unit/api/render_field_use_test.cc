// SPDX-License-Identifier: Apache-2.0
// Fields of a render request that belong to a projection, a mode or a form, or replace others; and
// random requests there and back. render_fields_test.cc has each field alone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "api/names.h"
#include "api/request_fields.h"
#include "tests/support/seed.h"
#include "tests/unit/api/render_decoding.h"

namespace kdray::api {
namespace {

using testing::HasSubstr;

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

TEST(Lights, NameThemselvesAndNoBodyWhereTheTextIsNotJson) {
  for (const char* text : {"", "[", "[%00]"}) {
    const auto query = Query("lights=" + std::string(text));
    EXPECT_THAT(query.problem().detail, HasSubstr(": lights is "));
    EXPECT_THAT(query.problem().detail, testing::Not(HasSubstr("body")));
  }
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

}  // namespace
}  // namespace kdray::api
