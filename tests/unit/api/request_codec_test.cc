#include "api/request_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "api/names.h"
#include "api/request_fields.h"
#include "tests/support/seed.h"

namespace kdray::api {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const Limits kLimits;
const std::string kSha256(64, 'a');

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
     {"perspective", "orthographic"},
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
    {"mode",
     "shaded",
     {"shaded", "normal", "depth", "triangle"},
     {"", "Shaded", "wireframe", "ambient-occlusion", "cost"},
     {"\"depth\""},
     {"\"cost\"", "\"x\""},
     kNotText},
    {"samples",
     "1",
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
     {"0,0,0", "1,1,1", "0.5,0.25,0"},
     {"-0.1,0,0", "0,1.1,0", "red", "transparent"},
     {"[0,0,0]", "[1,1,1]"},
     {"[0,0,1.001]", "[-0.001,0,0]"},
     kNotAVector},
    {"background",
     "",
     {"0,0,0", "1,1,1", "transparent"},
     {"2,0,0", "Transparent", "none"},
     {"[0,0,0]", "\"transparent\""},
     {"[0,0,2]"},
     {"null", "true", "1", "{}", "[]", "[0,0]", "[0,0,null]"}},
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

TEST(RenderFields, TakeEveryValueUpToTheirLimits) {
  for (const FieldCase& c : kRenderCases) {
    // The image must be small enough for the limits, and the projection the one of the field.
    const std::string small = c.name == "width"    ? "&height=1&region=0,0,1,1"
                              : c.name == "height" ? "&width=1&region=0,0,1,1"
                                                   : "";
    const bool ortho = c.name == "view_height";
    for (const std::string_view text : c.good_text) {
      const auto request =
          Query(Named(c, text) + small + (ortho ? "&projection=orthographic" : ""));
      EXPECT_TRUE(request) << Named(c, text) << ": " << request.problem().detail;
    }
    for (const std::string_view json : c.good_json) {
      std::string body = JsonNamed(c, json);
      if (!small.empty()) body.insert(1, "\"region\":[0,0,1,1],");
      if (ortho) body.insert(1, "\"projection\":\"orthographic\",");
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
    return std::vector<double>{number(k->min, k->max), number(k->min, k->max),
                               number(k->min, k->max)};
  }
  if (const auto* k = std::get_if<ChoiceKind>(&kind)) {
    return integer(0, static_cast<std::int64_t>(k->names.size()) - 1);
  }
  return std::vector<std::int64_t>{0, 0, 1, 1};  // the region
}

/// A parameter's text as the JSON value that means the same.
std::string AsJson(const FieldKind& kind, const std::string& text) {
  if (std::holds_alternative<ChoiceKind>(kind) || text == "transparent") return '"' + text + '"';
  const bool list =
      std::holds_alternative<VectorKind>(kind) || std::holds_alternative<IntegersKind>(kind);
  return list ? '[' + text + ']' : text;
}

// ---- Fields that belong to a projection, a mode or a form ----

struct Belonging {
  std::string_view field, text, default_text;               ///< default: empty without one
  std::vector<std::string_view> projections, modes, forms;  ///< empty: all
};

const std::vector<std::string_view> kSampledModes = {"shaded", "normal"};
const std::vector<Belonging> kBelongings = {
    {"fov_deg", "50", "40", {"perspective"}, {}, {}},
    {"view_height", "2", "", {"orthographic"}, {}, {}},
    {"samples", "4", "1", {}, kSampledModes, {}},
    {"seed", "3", "0", {}, kSampledModes, {}},
    {"max_samples", "64", "1024", {}, kSampledModes, {}},
    {"max_noise", "0.1", "", {}, kSampledModes, {}},
    {"budget_ms", "50", "", {}, kSampledModes, {}},
    {"color", "1,0,0", "0.93,0.88,0.81", {}, {"shaded"}, {}},
    {"background", "transparent", "", {}, {}, {"render.png"}},
    {"background", "0.5,0.5,0.5", "", {}, {}, {"render.png"}},
};

bool Holds(const std::vector<std::string_view>& names, std::string_view name) {
  return names.empty() || std::find(names.begin(), names.end(), name) != names.end();
}

bool IsUsed(std::string_view field, const RenderRequest& request) {
  return std::all_of(kBelongings.begin(), kBelongings.end(), [&](const Belonging& b) {
    return b.field != field ||
           (Holds(b.projections, Name(request.projection)) && Holds(b.modes, Name(request.mode)));
  });
}

TEST(UnusedFields, AreRefusedByNameUnlessTheyHaveTheirDefault) {
  for (const std::string_view projection : kProjectionNames) {
    for (const std::string_view mode : kRenderModeNames) {
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
          const bool is_list = text.find(',') != std::string::npos;
          const std::string value = is_list                 ? "[" + text + "]"
                                    : text == "transparent" ? "\"transparent\""
                                                            : text;
          const auto body = DecodeRenderBody(json + "\"" + name + "\":" + value + "}", form,
                                             std::nullopt, kLimits);
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
          for (const auto* owners : {&b.projections, &b.modes, &b.forms}) {
            for (const std::string_view owner : *owners) {
              EXPECT_THAT(query(text).problem().detail, HasSubstr(owner));
            }
          }
        }
      }
    }
  }
}

TEST(UnusedFields, MayHoldTheBackgroundThatTheModeHas) {
  for (const std::string mode : {"shaded", "normal", "depth", "triangle"}) {
    const bool white = mode == "shaded";
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
      if (decides && request.samples > 1) continue;
      // Whole images of random sides would mostly be too large.
      const bool side = field.name == "width" || field.name == "height";
      const FieldKind kind = side ? IntegerKind{1, 4096} : field.kind;
      const FieldValue value = RandomValue(kind, random);
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

TEST(RenderRequests, RefuseUnknownFieldsAndSayWhatThereIs) {
  const auto query = Query("widht=3");
  ASSERT_FALSE(query);
  EXPECT_EQ(query.problem().code, ErrorCode::kInvalidParameter);
  EXPECT_EQ(query.problem().parameter, "widht");
  EXPECT_THAT(query.problem().detail,
              HasSubstr("there is no 'widht' here; there are width, height"));
  const auto body = Body("{\n\n\"widht\":3}");
  ASSERT_FALSE(body);
  EXPECT_EQ(body.problem().code, ErrorCode::kInvalidParameter);
  EXPECT_EQ(body.problem().parameter, "/widht");
  EXPECT_EQ(body.problem().line, 3u);
}

TEST(RenderRequests, RefuseAnUnknownModeByNamingTheModesThereAre) {
  EXPECT_THAT(Query("mode=cost").problem().detail,
              HasSubstr("must be one of shaded, normal, depth, triangle, not 'cost'"));
}

TEST(RenderRequests, LetSamplesOrThePixelsDecide) {
  for (const char* query : {"samples=4&max_noise=0.1", "samples=4&budget_ms=100"}) {
    const auto request = Query(query);
    ASSERT_FALSE(request) << query;
    EXPECT_EQ(request.problem().code, ErrorCode::kInvalidParameter);
    EXPECT_EQ(request.problem().parameter, "samples");
    EXPECT_THAT(request.problem().detail, HasSubstr("max_samples"));
  }
  EXPECT_EQ(Body(R"({"samples":4,"max_noise":0.1})").problem().parameter, "/samples");
  EXPECT_TRUE(Query("samples=1&max_noise=0.1&max_samples=64&budget_ms=100"));
  EXPECT_TRUE(Query("samples=4&max_samples=64"));
}

TEST(RenderRequests, NameTheLimitThatAValueBreaks) {
  const auto below = Query("samples=0"), above = Body("{\"samples\":5000}");
  EXPECT_EQ(below.problem().limit, 1);
  EXPECT_EQ(below.problem().actual, 0);
  EXPECT_EQ(above.problem().limit, 1024);
  EXPECT_EQ(above.problem().actual, 5000);
  EXPECT_EQ(Query("fov_deg=180").problem().limit, 180);
}

TEST(RenderRequests, BoundTheImageThatIsRendered) {
  Limits limits;
  limits.max_pixels = 1000;
  limits.max_image_side = 100;
  const auto code = [&](std::string_view query) {
    const auto request = DecodeRenderQuery(query, ImageForm::kPng, limits);
    return request ? "ok" : std::string(Name(request.problem().code));
  };
  EXPECT_EQ(code("width=100&height=10"), "ok");
  EXPECT_EQ(code("width=101&height=1"), "image_too_large");
  EXPECT_EQ(code("width=1&height=101"), "image_too_large");
  EXPECT_EQ(code("width=50&height=21"), "image_too_large");
  EXPECT_EQ(code("width=1000000&height=1000000&region=999900,0,1000000,10"), "ok");
  EXPECT_EQ(code("width=1000000&height=1000000&region=999899,0,1000000,1"), "image_too_large");
  EXPECT_EQ(code("width=1048576&height=1048576&region=0,0,100,10"), "ok");
  EXPECT_EQ(code("width=1048577&height=1&region=0,0,1,1"), "invalid_parameter");
  const auto pixels = DecodeRenderQuery("width=50&height=21", ImageForm::kPng, limits);
  EXPECT_EQ(pixels.problem().limit, 1000);
  EXPECT_EQ(pixels.problem().actual, 1050);
}

TEST(RenderRequests, AdviseRegionsThatAreTaken) {
  Limits limits;
  limits.max_pixels = 1000;
  limits.max_image_side = 100;
  const auto detail = [&](const std::string& query) {
    const auto request = DecodeRenderQuery(query, ImageForm::kPng, limits);
    return request ? std::string("taken") : request.problem().detail;
  };
  for (const std::string image : {"width=101&height=1", "width=50&height=21"}) {
    EXPECT_THAT(detail(image), HasSubstr("ask for regions of it")) << image;
    EXPECT_EQ(detail(image + "&region=0,0,40,1"), "taken");
  }
  EXPECT_THAT(detail("width=300&height=300&region=0,0,101,1"), HasSubstr("smaller regions"));
}

TEST(RenderRequests, LetTheBackgroundBeAColourOrTransparent) {
  EXPECT_FALSE(Query("")->transparent);
  EXPECT_TRUE(Query("background=transparent")->transparent);
  const auto blue = Query("background=0,0,1");
  EXPECT_FALSE(blue->transparent);
  EXPECT_EQ(blue->background, (Vec3{0, 0, 1}));
}

TEST(RenderBodies, AreJsonObjectsAndNothingElse) {
  EXPECT_TRUE(DecodeRenderBody("{}", ImageForm::kPng, std::nullopt, kLimits));
  EXPECT_TRUE(
      DecodeRenderBody(" {} \n", ImageForm::kPng, "application/x-www-form-urlencoded", kLimits));
  EXPECT_EQ(DecodeRenderBody("{}", ImageForm::kPng, "text/plain", kLimits).problem().code,
            ErrorCode::kUnsupportedMediaType);
  EXPECT_EQ(DecodeRenderBody("{}", ImageForm::kPng, "application/x-npy", kLimits).problem().code,
            ErrorCode::kUnsupportedMediaType);
  for (const char* body : {"", " ", "[]", "null", "7", "\"x\"", "{", "{}{}", "{}x", "{\"width\":}",
                           "{\"width\":1,}", "width=1"}) {
    const auto request = Body(body);
    ASSERT_FALSE(request) << body;
    EXPECT_EQ(request.problem().code, ErrorCode::kInvalidJson) << body;
  }
  Limits limits;
  limits.max_json_body_bytes = 10;
  EXPECT_TRUE(DecodeRenderBody("{        }", ImageForm::kPng, std::nullopt, limits));
  const auto request = DecodeRenderBody("{         }", ImageForm::kPng, std::nullopt, limits);
  ASSERT_FALSE(request);
  EXPECT_EQ(request.problem().code, ErrorCode::kBodyTooLarge);
  EXPECT_EQ(request.problem().limit, 10);
  EXPECT_EQ(request.problem().actual, 11);
}

TEST(CanonicalQueries, LeaveOutWhatDoesNotChangeTheAnswer) {
  EXPECT_EQ(CanonicalQuery(*Query("deadline_ms=5")), CanonicalQuery(*Query("")));
  EXPECT_NE(CanonicalQuery(*Query("samples=2")), CanonicalQuery(*Query("")));
  EXPECT_EQ(CanonicalQuery(*DecodeCells("depth=007", kLimits)), "depth=7");
}

// ---- Options of ray queries ----

TEST(RayQueries, KeepTheirDefaultsWhenNothingIsAsked) {
  const auto options = DecodeClosestOptions("", kLimits);
  ASSERT_TRUE(options);
  EXPECT_EQ(options->precision, Precision::kAuto);
  EXPECT_THAT(options->fields,
              ElementsAre(RayField::kT, RayField::kTriangle, RayField::kU, RayField::kV));
  EXPECT_EQ(options->t_min, 0);
  EXPECT_EQ(options->t_max, std::nullopt);
  EXPECT_EQ(options->deadline_ms, 30000);
  EXPECT_EQ(options->dtype, std::nullopt);
}

TEST(RayQueries, TakeEveryOption) {
  const auto options = DecodeClosestOptions(
      "precision=watertight&fields=point,triangle&t_min=1e-6&t_max=0.999999&deadline_ms=1&dtype=f4",
      kLimits);
  ASSERT_TRUE(options) << options.problem().detail;
  EXPECT_EQ(options->precision, Precision::kWatertight);
  EXPECT_THAT(options->fields, ElementsAre(RayField::kPoint, RayField::kTriangle));
  EXPECT_EQ(options->t_min, 1e-6);
  EXPECT_EQ(options->t_max, 0.999999);
  EXPECT_EQ(options->deadline_ms, 1);
  EXPECT_EQ(options->dtype, NumberType::kF4);
  EXPECT_EQ(DecodeAnyOptions("t_max=inf", kLimits)->t_max, std::numeric_limits<double>::infinity());
  EXPECT_EQ(DecodeAnyOptions("t_min=-5&t_max=-5", kLimits)->t_max, -5);
  EXPECT_EQ(DecodeAnyOptions("t_max=1e-400", kLimits)->t_max, 0);
  EXPECT_EQ(DecodeAnyOptions("deadline_ms=600000", kLimits)->deadline_ms, 600000);
  EXPECT_EQ(DecodeClosestOptions("fields=t,triangle,u,v,normal,point", kLimits)->fields.size(), 6u);
}

TEST(RayQueries, RefuseEverythingElseByName) {
  const std::pair<std::string_view, std::string_view> cases[] = {
      {"precision=", "precision"},
      {"precision=float", "precision"},
      {"precision=FAST", "precision"},
      {"fields=", "fields"},
      {"fields=t,", "fields"},
      {"fields=t,t", "fields"},
      {"fields=T", "fields"},
      {"fields=distance", "fields"},
      {"t_min=", "t_min"},
      {"t_min=nan", "t_min"},
      {"t_min=inf", "t_min"},
      {"t_min=1e999", "t_min"},
      {"t_max=nan", "t_max"},
      {"t_max=-inf", "t_max"},
      {"t_max=Infinity", "t_max"},
      {"t_max=1e999", "t_max"},
      {"t_min=2&t_max=1", "t_min"},
      {"t_max=-1", "t_min"},
      {"deadline_ms=0", "deadline_ms"},
      {"deadline_ms=600001", "deadline_ms"},
      {"deadline_ms=1.5", "deadline_ms"},
      {"dtype=f2", "dtype"},
      {"dtype=<f4", "dtype"},
      {"dtype=", "dtype"},
      {"max_hits=5", "max_hits"},
      {"precison=fast", "precison"},
      {"dtype=f4&dtype=f4", "dtype"},
      {"=5", ""},
      {"t_min", "t_min"},
      {"T_MIN=1", "T_MIN"},
  };
  for (const auto& [query, parameter] : cases) {
    const auto options = DecodeClosestOptions(query, kLimits);
    ASSERT_FALSE(options) << query;
    EXPECT_EQ(options.problem().code, ErrorCode::kInvalidParameter) << query;
    EXPECT_EQ(options.problem().parameter, parameter) << query;
  }
  const auto any = DecodeAnyOptions("fields=t", kLimits);
  ASSERT_FALSE(any) << "any has no fields";
  EXPECT_THAT(any.problem().detail, HasSubstr("there are precision, t_min, t_max"));
}

// ---- The other paths ----

TEST(Uploads, TakeBuildMeshAndWait) {
  const auto plain = DecodeUpload("", kLimits);
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->build, Build::kAuto);
  EXPECT_EQ(plain->mesh, std::nullopt);
  EXPECT_EQ(plain->wait_ms, 30000);
  const auto full = DecodeUpload("wait_ms=60000&mesh=" + kSha256 + "&build=kd-cyclic", kLimits);
  ASSERT_TRUE(full) << full.problem().detail;
  EXPECT_EQ(full->build, Build::kKdCyclic);
  EXPECT_EQ(full->mesh, kSha256);
  EXPECT_EQ(full->wait_ms, 60000);
  EXPECT_EQ(DecodeUpload("wait_ms=0", kLimits)->wait_ms, 0);
  for (const std::string_view name : kBuildNames) {
    EXPECT_EQ(Name(DecodeUpload("build=" + std::string(name), kLimits)->build), name);
  }
  for (const std::string& query :
       {std::string("build="), std::string("build=kd"), std::string("wait_ms=60001"),
        std::string("wait_ms=-1"), std::string("mesh="), "mesh=" + kSha256 + "a",
        "mesh=" + kSha256.substr(1) + "A", "mesh=" + kSha256.substr(1) + "g",
        std::string("name=bunny")}) {
    EXPECT_FALSE(DecodeUpload(query, kLimits)) << query;
  }
}

TEST(Lists, TakeMeshLimitAndCursor) {
  EXPECT_EQ(DecodeList("", kLimits)->limit, 100);
  const auto list = DecodeList("mesh=" + kSha256 + "&limit=1000&after=abc-1", kLimits);
  ASSERT_TRUE(list);
  EXPECT_EQ(list->mesh, kSha256);
  EXPECT_EQ(list->limit, 1000);
  EXPECT_EQ(list->after, "abc-1");
  for (const std::string_view query :
       {"limit=0", "limit=1001", "limit=x", "mesh=x", "after=%00", "after=a%20b", "page=2"}) {
    EXPECT_FALSE(DecodeList(query, kLimits)) << query;
  }
}

TEST(Descriptions, TakeWait) {
  EXPECT_EQ(DecodeDescribe("", kLimits)->wait_ms, 0);
  EXPECT_EQ(DecodeDescribe("wait_ms=60000", kLimits)->wait_ms, 60000);
  EXPECT_FALSE(DecodeDescribe("wait_ms=60001", kLimits));
  EXPECT_FALSE(DecodeDescribe("build=box", kLimits));
}

TEST(CellLists, NeedTheirDepth) {
  EXPECT_EQ(DecodeCells("depth=0", kLimits)->depth, 0);
  EXPECT_EQ(DecodeCells("depth=255", kLimits)->depth, 255);
  for (const std::string_view query : {"depth=-1", "depth=256", "depth=", "depth=1.0"}) {
    EXPECT_FALSE(DecodeCells(query, kLimits)) << query;
  }
  const auto missing = DecodeCells("", kLimits);
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.problem().parameter, "depth");
  EXPECT_THAT(missing.problem().detail, HasSubstr("is missing; it must be an integer from 0"));
}

TEST(PathsWithoutParameters, RefuseAny) {
  EXPECT_FALSE(CheckNoParameters("").has_value());
  EXPECT_FALSE(CheckNoParameters("&").has_value());
  const Check refused = CheckNoParameters("x=1");
  ASSERT_TRUE(refused.has_value());
  EXPECT_EQ(refused->parameter, "x");
  EXPECT_THAT(refused->detail, HasSubstr("none is allowed"));
  EXPECT_TRUE(CheckNoParameters("%").has_value());
}

}  // namespace
}  // namespace kdray::api
