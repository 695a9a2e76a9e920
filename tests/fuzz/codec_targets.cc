// SPDX-License-Identifier: Apache-2.0
// The decoders of libraries that compressed meshes need, called as core/io calls them.
#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>
#include <meshoptimizer.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

#include "codec/draco_decoder.h"
#include "core/io/meshopt_decoder.h"
#include "tests/fuzz/fuzz_target.h"

namespace kdray::fuzz {
namespace {

// The first bytes of an input say what the others are.
struct MeshoptInput {
  std::uint8_t mode, filter;
  std::uint16_t stride;
  std::uint32_t count;
};

bool FuzzMeshopt(std::span<const std::byte> input) {
  MeshoptInput head;
  if (input.size() < sizeof head) return false;
  std::memcpy(&head, input.data(), sizeof head);
  const std::span<const std::byte> encoded = input.subspan(sizeof head);
  const core::MeshoptForm form{static_cast<core::MeshoptMode>(head.mode % 3),
                               static_cast<core::MeshoptFilter>(head.filter % 4), head.stride,
                               head.count};
  if (const auto why = core::WhyNotMeshopt(form, encoded.size())) {
    Require(!why->empty(), "an error says what is wrong");
    return false;
  }
  Require(form.Bytes() <= core::kMaxMeshoptBytes, "a view is bounded");
  Require(form.Bytes() <= 64 * encoded.size(), "a view is bounded by its encoded bytes");
  std::vector<std::byte> decoded(form.Bytes()), again(form.Bytes(), std::byte{0xff});
  core::CancelPoll poll{core::CancelToken()};
  const core::Status status = core::DecodeMeshopt(form, encoded, decoded, &poll);
  Require(status.ok() || !status.error().message.empty(), "an error says what is wrong");
  const bool is_valid = status.ok();
  Require(core::DecodeMeshopt(form, encoded, again, &poll).ok() == is_valid,
          "an input is valid or not");
  Require(!is_valid || decoded == again, "every decoded byte depends on the input alone");
  return is_valid;
}

Bytes MeshoptSeed(MeshoptInput head, const std::vector<unsigned char>& encoded) {
  Bytes seed(sizeof head + encoded.size());
  std::memcpy(seed.data(), &head, sizeof head);
  std::memcpy(seed.data() + sizeof head, encoded.data(), encoded.size());
  return seed;
}

std::vector<Bytes> MeshoptSeeds() {
  constexpr std::uint32_t kSide = 20;
  std::vector<std::array<std::int16_t, 4>> vertices;
  std::vector<std::uint32_t> indices;
  for (std::uint32_t y = 0; y < kSide; ++y) {
    for (std::uint32_t x = 0; x < kSide; ++x) {
      vertices.push_back({static_cast<std::int16_t>(300 * x), static_cast<std::int16_t>(200 * y),
                          static_cast<std::int16_t>(x * y % 7), 127});
      if (x + 1 == kSide || y + 1 == kSide) continue;
      const std::uint32_t a = y * kSide + x, b = a + 1, c = a + kSide, d = c + 1;
      indices.insert(indices.end(), {a, b, d, a, d, c});
    }
  }
  const auto count = static_cast<std::uint32_t>(vertices.size());
  const auto corners = static_cast<std::uint32_t>(indices.size());
  std::vector<Bytes> seeds;
  meshopt_encodeVertexVersion(0);
  meshopt_encodeIndexVersion(1);
  for (std::uint8_t filter = 0; filter < 4; ++filter) {
    const std::uint16_t stride = filter == 3 ? 16 : 8;
    const std::uint32_t elements = count * 8 / stride;
    std::vector<unsigned char> encoded(meshopt_encodeVertexBufferBound(elements, stride));
    encoded.resize(meshopt_encodeVertexBuffer(encoded.data(), encoded.size(), vertices.data(),
                                              elements, stride));
    seeds.push_back(MeshoptSeed({0, filter, stride, elements}, encoded));
  }
  for (const std::uint16_t stride : {2, 4}) {
    std::vector<unsigned char> triangles(meshopt_encodeIndexBufferBound(corners, count));
    triangles.resize(
        meshopt_encodeIndexBuffer(triangles.data(), triangles.size(), indices.data(), corners));
    seeds.push_back(MeshoptSeed({1, 0, stride, corners}, triangles));
    std::vector<unsigned char> sequence(meshopt_encodeIndexSequenceBound(corners, count));
    sequence.resize(
        meshopt_encodeIndexSequence(sequence.data(), sequence.size(), indices.data(), corners));
    seeds.push_back(MeshoptSeed({2, 0, stride, corners}, sequence));
  }
  return seeds;
}

// The first bytes of an input are the counts that a file would claim.
struct DracoInput {
  std::uint32_t vertices, triangles;
};

bool FuzzDraco(std::span<const std::byte> input) {
  constexpr std::uint32_t kMost = 200;  // damaged data take long
  DracoInput head;
  if (input.size() < sizeof head) return false;
  std::memcpy(&head, input.data(), sizeof head);
  if (head.vertices > kMost || head.triangles > kMost) return false;
  const std::string_view data = AsText(input).substr(sizeof head);
  const codec::DracoClaims claims{head.vertices,
                                  head.triangles,
                                  {{0, 5126, 3, true}, {1, 5126, 3, false}, {2, 5126, 2, false}}};
  const std::string answer = codec::DecodeDraco(data, claims);
  Require(answer.size() > 1 && (answer[0] == 'm' || answer[0] == 'e'), "there is an answer");
  if (answer[0] == 'e') return false;
  std::size_t at = 1;
  for (std::uint64_t i = 0; i < std::uint64_t{3} * head.triangles; ++i, at += 4) {
    std::uint32_t corner;
    Require(at + 4 <= answer.size(), "each corner is there");
    std::memcpy(&corner, answer.data() + at, sizeof corner);
    Require(corner < head.vertices, "a corner names a vertex");
  }
  for (const codec::WantedAttribute& wanted : claims.attributes) {
    Require(at < answer.size(), "each attribute is there or not");
    const bool is_there = answer[at++] == 1;
    Require(is_there || !wanted.is_needed, "a needed attribute is there");
    if (is_there)
      at += std::size_t{4} * static_cast<std::size_t>(wanted.components) * head.vertices;
  }
  Require(at == answer.size(), "each vertex has a value");
  return true;
}

// A grid of side x side vertices with normals and texture coordinates.
Bytes DracoSeed(std::uint32_t side, int method) {
  draco::Mesh mesh;
  mesh.set_num_points(side * side);
  const auto add = [&](draco::GeometryAttribute::Type type, int components, const auto& value) {
    draco::GeometryAttribute form;
    form.Init(type, nullptr, static_cast<std::int8_t>(components), draco::DT_FLOAT32, false,
              static_cast<std::int64_t>(sizeof(float)) * components, 0);
    const int id = mesh.AddAttribute(form, true, side * side);
    for (std::uint32_t i = 0; i < side * side; ++i) {
      const std::array<float, 3> numbers = value(i % side, i / side);
      mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), numbers.data());
    }
  };
  const auto position = [](std::uint32_t x, std::uint32_t y) -> std::array<float, 3> {
    return {static_cast<float>(x), static_cast<float>(y), 0.25f * static_cast<float>(x * y % 5)};
  };
  add(draco::GeometryAttribute::POSITION, 3, position);
  add(draco::GeometryAttribute::NORMAL, 3, [](std::uint32_t x, std::uint32_t) {
    return std::array<float, 3>{x % 2 == 0 ? 1.f : 0.f, x % 2 == 0 ? 0.f : 1.f, 0.f};
  });
  add(draco::GeometryAttribute::TEX_COORD, 2, position);
  for (std::uint32_t y = 0; y + 1 < side; ++y) {
    for (std::uint32_t x = 0; x + 1 < side; ++x) {
      const draco::PointIndex a(y * side + x), b(a.value() + 1), c(a.value() + side),
          d(c.value() + 1);
      mesh.AddFace({a, b, d});
      mesh.AddFace({a, d, c});
    }
  }
  draco::Encoder encoder;
  encoder.SetTrackEncodedProperties(true);
  encoder.SetEncodingMethod(method);
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 10);
  encoder.SetAttributeQuantization(draco::GeometryAttribute::NORMAL, 8);
  encoder.SetAttributeQuantization(draco::GeometryAttribute::TEX_COORD, 10);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok()) return {};
  const DracoInput head{static_cast<std::uint32_t>(encoder.num_encoded_points()),
                        static_cast<std::uint32_t>(encoder.num_encoded_faces())};
  Bytes seed(sizeof head + buffer.size());
  std::memcpy(seed.data(), &head, sizeof head);
  std::memcpy(seed.data() + sizeof head, buffer.data(), buffer.size());
  return seed;
}

// By both methods, and small: damaged data take milliseconds each.
std::vector<Bytes> DracoSeeds() {
  return {DracoSeed(4, draco::MESH_SEQUENTIAL_ENCODING),
          DracoSeed(4, draco::MESH_EDGEBREAKER_ENCODING)};
}

const FuzzTarget kTargets[] = {{"meshopt", FuzzMeshopt, MeshoptSeeds},
                               {"draco", FuzzDraco, DracoSeeds}};

}  // namespace

std::span<const FuzzTarget> CodecTargets() { return kTargets; }

}  // namespace kdray::fuzz
