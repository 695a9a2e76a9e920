// SPDX-License-Identifier: Apache-2.0
// Prints a digest of many answers for each mesh, build and precision: the same lines whatever
// compiler and optimisation made the program. tests/compilers compares them (N22). Its inputs are
// made of integers and exactly rounded operations, so that they are the same as well.
#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "core/trace/trace.h"

namespace kdray::test {
namespace {

using namespace core;

/// xorshift64*: the standard's distributions may differ between libraries.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t Bits() {
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return state_ * 0x2545f4914f6cdd1dULL;
  }
  /// In [-1, 1), a multiple of 2^-52.
  double Signed() { return static_cast<double>(Bits() >> 11) * 0x1p-52 - 1; }
  Vec3d Point() {
    const double x = Signed(), y = Signed();
    return {x, y, Signed()};
  }

 private:
  std::uint64_t state_;
};

/// FNV-1a over the bits of numbers.
class Digest {
 public:
  void Add(std::uint64_t bits) {
    for (int i = 0; i < 8; ++i) {
      value_ ^= bits >> (8 * i) & 0xff;
      value_ *= 0x100000001b3ULL;
    }
  }
  void Add(double number) { Add(std::bit_cast<std::uint64_t>(number)); }
  void Add(const Hit& hit) {
    for (const double number : {hit.t, hit.u, hit.v}) Add(number);
    Add(std::uint64_t{hit.primitive_id});
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325ULL;
};

/// Triangles of all sizes, some flat, some on lattice points, far from the origin or not, with
/// vertices that float holds or not.
MeshData MakeMesh(bool on_lattice, const Vec3d& place, bool is_float, Random* random) {
  MeshData data;
  for (std::uint32_t i = 0; i < 400; ++i) {
    const double size = std::bit_cast<double>((1023 - random->Bits() % 12) << 52);  // 2^-11 to 1
    const Vec3d middle = random->Point();
    for (int k = 0; k < 3; ++k) {
      Vec3d v = middle + random->Point() * size;
      for (int axis = 0; axis < 3; ++axis) {
        if (on_lattice) v[axis] = static_cast<double>(static_cast<int>(v[axis] * 4)) / 4;
        if (is_float) v[axis] = static_cast<double>(static_cast<float>(v[axis]));
      }
      data.vertices.push_back(place + v);
    }
    data.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return data;
}

std::vector<Ray> MakeRays(const MeshData& data, const Vec3d& place, Random* random) {
  std::vector<Ray> rays;
  while (rays.size() < 2'000) {
    const Vec3d& a = data.vertices[random->Bits() % data.vertices.size()];
    const Vec3d& b = data.vertices[random->Bits() % data.vertices.size()];
    Ray ray;
    switch (rays.size() % 4) {
      case 0:
        ray.origin = place + random->Point();
        ray.direction = random->Point();
        break;
      case 1:  // at a vertex
        ray.origin = place + random->Point() * 2.0;
        ray.direction = a - ray.origin;
        break;
      case 2:  // in an axis-parallel plane through a vertex, from another
        ray.origin = b;
        ray.direction = a - b;
        ray.direction[static_cast<int>(random->Bits() % 3)] = 0;
        break;
      default:  // from far away
        ray.direction = random->Point();
        ray.origin = a - ray.direction * 0x1p20;
    }
    if (random->Bits() % 4 == 0) ray.t_max = random->Signed() + 1;
    if (IsValid(ray)) rays.push_back(ray);
  }
  return rays;
}

void Print(const std::string& what, const Digest& digest) {
  std::printf("%-50s %016llx\n", what.c_str(), static_cast<unsigned long long>(digest.value()));
}

void PrintAnswers(const std::string& name, const MeshData& data, const std::vector<Ray>& rays) {
  const auto mesh = std::make_shared<const TriangleMesh>(TriangleMesh::Create(data).value());
  const std::span<const Ray> batch(rays);
  for (const BuildKind build : kAllBuildKinds) {
    const Scene scene{mesh, std::make_shared<const Tree>(BuildTree(*mesh, build).value())};
    const std::string where = name + " " + std::string(Name(build)) + " ";
    // The trees themselves are kept on disk by a name that says how they were made.
    Digest tree;
    tree.Add(scene.tree->stats.nodes);
    tree.Add(scene.tree->stats.references);
    tree.Add(scene.tree->stats.sah_cost);
    Print(where + "tree", tree);
    for (const Precision precision : kAllPrecisions) {
      TraceOptions options;
      options.precision = precision;
      std::vector<Hit> hits(rays.size());
      std::vector<std::uint8_t> occluded(rays.size());
      Digest digest;
      if (!TraceClosest(scene, batch, options, hits).ok() ||
          !TraceAny(scene, batch, options, occluded).ok()) {
        std::abort();
      }
      for (const Hit& hit : hits) digest.Add(hit);
      for (const std::uint8_t o : occluded) digest.Add(std::uint64_t{o});
      Print(where + std::string(Name(precision)), digest);
    }
    Digest digest;
    const AllHits all = TraceAll(scene, batch, {Precision::kExact, {}}, 64).value();
    for (const Hit& hit : all.hits) digest.Add(hit);
    for (const std::size_t first : all.first) digest.Add(std::uint64_t{first});
    Print(where + "crossings", digest);
  }
}

}  // namespace
}  // namespace kdray::test

int main() {
  using namespace kdray;
  for (const bool on_lattice : {false, true}) {
    for (const bool is_float : {false, true}) {
      for (const core::Vec3d& place :
           {core::Vec3d{0, 0, 0}, core::Vec3d{448'251, 5'411'932, 122}}) {
        test::Random random(0x9e3779b97f4a7c15ULL);
        const core::MeshData data = test::MakeMesh(on_lattice, place, is_float, &random);
        const std::string name = std::string(on_lattice ? "lattice" : "soup") +
                                 (is_float ? " float" : " double") + (place.x != 0 ? " far" : "");
        test::PrintAnswers(name, data, test::MakeRays(data, place, &random));
      }
    }
  }
}
