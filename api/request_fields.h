// SPDX-License-Identifier: Apache-2.0
// The tables of fields of every request: names, ranges and defaults of the contract. A test
// compares them with api/openapi.yaml.
#pragma once

#include "api/field.h"
#include "api/limits.h"
#include "api/points.h"
#include "api/types.h"
#include "api/visibility.h"

namespace kdray::api {

FieldTable<UploadRequest> UploadFields(const Limits& limits);
FieldTable<ListRequest> ListFields();
FieldTable<DescribeRequest> DescribeFields(const Limits& limits);
FieldTable<MeasureRequest> MeasureFields(const Limits& limits);
FieldTable<CellsRequest> CellsFields();
FieldTable<RayOptions> ClosestFields(const Limits& limits);
FieldTable<RayOptions> AnyFields(const Limits& limits);
FieldTable<PointOptions> ClosestPointFields(const Limits& limits);
FieldTable<PointOptions> SideFields(const Limits& limits);  ///< signed-distance and inside
FieldTable<VisibilityOptions> VisibilityFields(const Limits& limits);
FieldTable<RayOptions> CountFields(const Limits& limits);
FieldTable<RayOptions> AllFields(const Limits& limits);
FieldTable<RenderRequest> RenderFields(const Limits& limits);

}  // namespace kdray::api
