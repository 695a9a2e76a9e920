// SPDX-License-Identifier: Apache-2.0
#include "api/request_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "api/names.h"
#include "api/request_fields.h"

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

TEST(RenderRequests, TakeAPlusSignBeforeANumber) {
  const auto request = Query("eye=+1,-2,+3e+1");
  ASSERT_TRUE(request);
  EXPECT_EQ(request->eye, (Vec3{1, -2, 30}));
  EXPECT_EQ(DecodeAnyOptions("t_min=%2B.5", kLimits)->t_min, 0.5);
  for (const char* query : {"eye=+,1,2", "eye=++1,0,0", "eye=+-1,0,0", "width=+1"}) {
    EXPECT_FALSE(Query(query)) << query;
  }
}

TEST(RenderRequests, RefuseAnUnknownModeByNamingTheModesThereAre) {
  EXPECT_THAT(Query("mode=wireframe").problem().detail,
              HasSubstr("must be one of shaded, normal, depth, triangle, ambient-occlusion, cost, "
                        "position, not 'wireframe'"));
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
  EXPECT_FALSE(options->auto_t_min || options->auto_t_max);
  EXPECT_EQ(options->cull, Cull::kNone);
  EXPECT_EQ(options->deadline_ms, 30000);
  EXPECT_EQ(options->dtype, std::nullopt);
  EXPECT_EQ(DecodeAllOptions("", kLimits)->max_hits, 64);
}

TEST(RayQueries, TakeAutoForEitherEndOfTheInterval) {
  const auto both = DecodeCountOptions("t_min=auto&t_max=auto&cull=back", kLimits);
  ASSERT_TRUE(both) << both.problem().detail;
  EXPECT_TRUE(both->auto_t_min && both->auto_t_max);
  EXPECT_EQ(both->t_min, 0);
  EXPECT_EQ(both->t_max, 1) << "the ray ends at origin + direction";
  EXPECT_EQ(both->cull, Cull::kBack);
  const auto begin = DecodeAllOptions("t_min=auto&t_max=5&max_hits=1024", kLimits);
  ASSERT_TRUE(begin);
  EXPECT_TRUE(begin->auto_t_min && !begin->auto_t_max);
  EXPECT_EQ(begin->t_max, 5);
  EXPECT_EQ(begin->max_hits, 1024);
  EXPECT_TRUE(DecodeAnyOptions("t_min=1&t_max=auto", kLimits));
  for (const char* query : {"t_min=1.5&t_max=auto", "t_min=auto&t_max=-1", "t_min=Auto",
                            "t_max=automatic", "t_min=auto,auto"}) {
    EXPECT_FALSE(DecodeAnyOptions(query, kLimits)) << query;
  }
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
  EXPECT_EQ(DecodeClosestOptions("fields=t,triangle,u,v,normal,point,side,group,uv,shading_normal",
                                 kLimits)
                ->fields.size(),
            10u);
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
      {"t_max=-1", "t_max"},
      {"deadline_ms=0", "deadline_ms"},
      {"deadline_ms=600001", "deadline_ms"},
      {"deadline_ms=1.5", "deadline_ms"},
      {"dtype=f2", "dtype"},
      {"dtype=<f4", "dtype"},
      {"dtype=", "dtype"},
      {"max_hits=5", "max_hits"},
      {"cull=", "cull"},
      {"cull=both", "cull"},
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
  EXPECT_THAT(any.problem().detail, HasSubstr("there are precision, t_min, t_max, cull"));
  for (const char* query : {"max_hits=0", "max_hits=1025", "max_hits=-1", "max_hits=x"}) {
    EXPECT_EQ(DecodeAllOptions(query, kLimits).problem().parameter, "max_hits") << query;
    EXPECT_FALSE(DecodeCountOptions(query, kLimits)) << query;
  }
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
  EXPECT_THAT(refused->detail, HasSubstr("there is no 'x' here; no parameter is allowed"));
  EXPECT_TRUE(CheckNoParameters("%").has_value());
}

}  // namespace
}  // namespace kdray::api
