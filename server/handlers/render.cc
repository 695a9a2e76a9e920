// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/render.h"

#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "api/batch_codec.h"
#include "api/json_pointer.h"
#include "api/json_text.h"
#include "api/names.h"
#include "api/request_codec.h"
#include "server/handlers/answers.h"
#include "server/handlers/computation.h"

namespace kdray::server {
namespace {

using api::ImageForm;

HttpBody NpyBody(api::ImageArray image) {
  using Array = std::pair<std::string, api::ImageArray>;
  std::string header = api::ImageHeader(image);
  const auto array = std::make_shared<const Array>(std::move(header), std::move(image));
  return HttpBody::Of({array->first, api::ImageBytes(array->second)}, array);
}

api::Outcome<HttpResponse> AnswerRender(const HandlerContext& context, RoutedRequest& routed,
                                        const api::RenderRequest& request, ImageForm form) {
  const TimeLimit limit{.ms = request.deadline_ms,
                        .default_ms = api::RenderRequest().deadline_ms,
                        .parameter = "deadline_ms"};
  const bool needs_binary_tree = request.cells_depth || request.mode == api::RenderMode::kCost;
  const TreeUse use = needs_binary_tree ? TreeUse::kCells : TreeUse::kRays;
  const auto computation =
      BeginComputation(context, routed, use, limit, WorkOfPicture(request, form));
  if (!computation) return computation.problem();
  auto memory = context.memory.Take(MemoryOfPicture(request, form), api::ErrorCode::kImageTooLarge,
                                    computation->tree->bytes());
  if (!memory) return memory.problem();
  auto answer = computation->tree->Render(request, form == ImageForm::kPng, computation->cancel);
  if (!answer) return limit.Explain(std::move(answer).problem());
  routed.timing.trace_ms = answer->trace_ms;
  context.metrics.CountPicture(answer->counts);

  const Stopwatch encoding;
  HttpResponse response;
  if (auto* bytes = std::get_if<std::vector<std::byte>>(&answer->image)) {
    response.body = std::move(*bytes);
  } else {
    response.body = NpyBody(std::get<api::ImageArray>(std::move(answer->image)));
  }
  memory->ShrinkTo(response.body.size());
  response.body.Own(std::make_shared<const RequestMemory::Share>(*std::move(memory)));
  routed.timing.encode_ms = answer->encode_ms + encoding.ms();
  response.headers.Add("Content-Type", form == ImageForm::kPng ? "image/png" : "application/x-npy");
  response.headers.Add("Kdray-Precision", api::Name(answer->precision));
  response.headers.Add("Kdray-Samples", std::to_string(answer->samples));
  if (answer->noise) response.headers.Add("Kdray-Noise", api::NumberText(*answer->noise));
  response.headers.Add("Kdray-Stopped", api::Name(answer->stopped));
  if (const auto& range = answer->depth_range) {
    response.headers.Add("Kdray-Depth-Range",
                         api::NumberText((*range)[0]) + "," + api::NumberText((*range)[1]));
  }
  return response;
}

bool IsCut(const HttpResponse& response) {
  const auto stopped = response.headers.Find("Kdray-Stopped");
  return stopped && *stopped == api::Name(api::Stopped::kBudget);
}

api::Outcome<HttpResponse> Get(const HandlerContext& context, RoutedRequest& routed,
                               ImageForm form) {
  const auto request = api::DecodeRenderQuery(routed.http.query_string, form, context.limits);
  if (!request) return request.problem();
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  const std::string etag = MakeEtag(form == ImageForm::kPng ? "render.png" : "render.npy",
                                    routed.path_parameter, api::CanonicalQuery(*request));
  if (ClientHas(routed.http, etag)) return NotModified(context, etag, Caching::kHour);
  auto response = AnswerRender(context, routed, *request, form);
  if (!response) return response;
  // The next image may be better in the same time.
  if (IsCut(*response)) {
    SetCaching(*response, context, Caching::kNever);
    return response;
  }
  response->headers.Add("ETag", etag);
  SetCaching(*response, context, Caching::kHour);
  return response;
}

/// The backend names a field; for a JSON body, the name becomes a pointer.
api::Problem WithPointer(api::Problem problem) {
  if (problem.parameter && !problem.parameter->starts_with('/')) {
    problem.parameter = api::PointerStep(*problem.parameter);
  }
  return problem;
}

api::Outcome<HttpResponse> Post(const HandlerContext& context, RoutedRequest& routed,
                                ImageForm form) {
  if (auto problem = api::CheckNoParameters(routed.http.query_string)) {
    problem->detail += "; the fields of a POST are in its JSON body";
    return *std::move(problem);
  }
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  const auto body = ReadWholeBody(context, routed, context.limits.max_json_body_bytes, {});
  if (!body) return body.problem();
  const Stopwatch parsing;
  const auto request = api::DecodeRenderBody(
      body->text, form, routed.http.headers.Find("Content-Type"), context.limits);
  if (!request) return request.problem();
  routed.timing.parse_ms = parsing.ms();
  auto response = AnswerRender(context, routed, *request, form);
  if (!response) return WithPointer(std::move(response).problem());
  SetCaching(*response, context, Caching::kNever);
  return response;
}

}  // namespace

api::Outcome<HttpResponse> GetRenderPng(const HandlerContext& context, RoutedRequest& routed) {
  return Get(context, routed, ImageForm::kPng);
}
api::Outcome<HttpResponse> PostRenderPng(const HandlerContext& context, RoutedRequest& routed) {
  return Post(context, routed, ImageForm::kPng);
}
api::Outcome<HttpResponse> GetRenderNpy(const HandlerContext& context, RoutedRequest& routed) {
  return Get(context, routed, ImageForm::kNpy);
}
api::Outcome<HttpResponse> PostRenderNpy(const HandlerContext& context, RoutedRequest& routed) {
  return Post(context, routed, ImageForm::kNpy);
}

}  // namespace kdray::server
