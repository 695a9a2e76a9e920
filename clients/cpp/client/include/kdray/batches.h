// SPDX-License-Identifier: Apache-2.0
// Batches of rays and points in memory, with typed answers. Client::Query takes and gives bytes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "kdray/client.h"

namespace kdray::client {

using Vector3 = std::array<double, 3>;

/// The half-line origin + t * direction, t >= 0; the direction need not be a unit vector.
struct Ray {
  Vector3 origin;
  Vector3 direction;
};

/// A miss has triangle -1 and an infinite t, an invalid ray a NaN as t.
struct Hit {
  double t = 0;                ///< counts lengths of the direction
  std::int64_t triangle = -1;  ///< position in the mesh file, from 0
  double u = 0, v = 0;         ///< weights of the triangle's second and third vertex

  bool IsHit() const { return triangle >= 0; }
};

struct ClosestPoint {
  double distance = 0;
  Vector3 point = {};
  std::int64_t triangle = -1;
};

enum class Side : std::int8_t { kOutside = 0, kInside = 1, kUnknown = -1 };

// One answer for each row, in order. `options` are the contract's parameters of the query:
// {{"precision", "exact"}, {"t_min", "auto"}}; `fields` and `dtype` are set here. Batches larger
// than the server accepts are sent in parts. Errors as Client; ConnectionError also for an answer
// that is not the contract's array.

/// POST …/rays/closest: the first hit of each ray.
std::vector<Hit> ClosestHits(Client& client, const std::string& id, std::span<const Ray> rays,
                             const Parameters& options = {});

/// POST …/rays/any: 1 if a ray hits anything, else 0.
std::vector<std::uint8_t> AnyHits(Client& client, const std::string& id, std::span<const Ray> rays,
                                  const Parameters& options = {});

/// POST …/rays/count: how many triangles each ray crosses; exact.
std::vector<std::uint64_t> CountHits(Client& client, const std::string& id,
                                     std::span<const Ray> rays, const Parameters& options = {});

/// POST …/points/closest.
std::vector<ClosestPoint> ClosestPoints(Client& client, const std::string& id,
                                        std::span<const Vector3> points,
                                        const Parameters& options = {});

/// POST …/points/signed-distance: negative inside, NaN where the sign is uncertain.
std::vector<double> SignedDistances(Client& client, const std::string& id,
                                    std::span<const Vector3> points,
                                    const Parameters& options = {});

/// POST …/points/inside.
std::vector<Side> Inside(Client& client, const std::string& id, std::span<const Vector3> points,
                         const Parameters& options = {});

}  // namespace kdray::client
