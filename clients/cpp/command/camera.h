// SPDX-License-Identifier: Apache-2.0
// The camera positions that the command computes itself: around a turntable, and the directions of
// a scan. Everything else about cameras is the server's.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "kdray/batches.h"
#include "kdray/document.h"

namespace kdray::client {

/// "1,2,3" as three finite numbers. Throws UsageError, which names `option`, for anything else.
Vector3 ParseVector(const std::string& text, const char* option);

/// "x,y,z" with the digits that give the same doubles back.
std::string VectorParameter(const Vector3& v);

Vector3 operator+(const Vector3& a, const Vector3& b);
Vector3 operator-(const Vector3& a, const Vector3& b);
Vector3 operator*(double factor, const Vector3& v);
double Dot(const Vector3& a, const Vector3& b);
Vector3 Cross(const Vector3& a, const Vector3& b);
double Length(const Vector3& v);

/// The sphere around a mesh's bounds.
struct Framing {
  Vector3 center = {};
  double radius = 1;  ///< above 0

  /// From the description of a tree. Throws UsageError if it has no bounds.
  static Framing Of(const Document& description);
};

/// From the mesh to a viewer, a unit vector: on the side that `view` names as the contract does
/// (`front`, `back`, `left`, `right`, `iso`; not `top`, `bottom`), and without one 30 degrees to
/// the right of the front and 20 above. @pre `up` is a unit vector.
std::optional<Vector3> TowardViewer(const Vector3& up, const std::string& view);

/// `v` turned by `angle` (radians, right-handed) around the unit vector `axis`.
Vector3 Turned(const Vector3& v, const Vector3& axis, double angle);

}  // namespace kdray::client
