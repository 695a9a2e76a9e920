// SPDX-License-Identifier: Apache-2.0
// Every typed batch of the library on the sample cube, and an error; install_test.py knows the
// answers.
#include <kdray/batches.h>
#include <kdray/error.h>
#include <kdray/upload.h>

#include <iostream>
#include <limits>

namespace client = kdray::client;

int main(int, char** arguments) {
  client::Client service(arguments[1]);
  const client::UploadResult cube =
      client::UploadMesh(service, client::Payload::OfFile(arguments[2]), "bvh");
  const std::string id = cube.tree.id;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<client::Ray> rays = {
      {{0.1, 5, 0.2}, {0, -1, 0}}, {{0.1, 5, 0.2}, {0, 1, 0}}, {{nan, 5, 0.2}, {0, -1, 0}}};
  for (const client::Hit& hit : client::ClosestHits(service, id, rays)) {
    std::cout << "hit " << hit.IsHit() << " " << hit.t << "\n";
  }
  for (const int any : client::AnyHits(service, id, rays)) std::cout << "any " << any << "\n";
  for (const auto count : client::CountHits(service, id, rays))
    std::cout << "count " << count << "\n";
  const std::vector<client::Vector3> points = {{0.1, 5, 0.2}, {0, 0, 0}};
  for (const auto& closest : client::ClosestPoints(service, id, points)) {
    std::cout << "distance " << closest.distance << " at y " << closest.point[1] << "\n";
  }
  for (const double distance : client::SignedDistances(service, id, points)) {
    std::cout << "signed " << distance << "\n";
  }
  for (const client::Side side : client::Inside(service, id, points)) {
    std::cout << "inside " << static_cast<int>(side) << "\n";
  }
  // More than a part.
  const std::vector<client::Ray> many(1'000'001, rays[0]);
  std::cout << "many " << client::ClosestHits(service, id, many).back().t << "\n";
  try {
    client::ClosestHits(service, id, rays, {{"precision", "perfect"}});
  } catch (const client::Refusal& refusal) {
    std::cout << "refused " << refusal.problem.status << " " << *refusal.problem.parameter << "\n";
  }
}
