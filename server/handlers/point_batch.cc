// SPDX-License-Identifier: Apache-2.0
#include "server/handlers/point_batch.h"

#include <utility>

namespace kdray::server {

api::Outcome<PointBatch> ReadPointBatch(const HandlerContext& context, const RoutedRequest& routed,
                                        const WorkOfBody& work) {
  if (auto problem = context.backend.Find(routed.path_parameter)) return *std::move(problem);
  auto body = ReadWholeBody(context, routed, context.limits.MaxBatchBytes(), work);
  if (!body) return std::move(body).problem();
  const HttpHeaders& headers = routed.http.headers;
  const auto type = api::DetectBatchType(body->text, headers.Find("Content-Type"));
  if (!type) return type.problem();
  const auto answer_type = api::ChooseAnswerType(headers.Find("Accept"), *type);
  if (!answer_type) return answer_type.problem();
  return PointBatch{*std::move(body), *type, *answer_type};
}

}  // namespace kdray::server
