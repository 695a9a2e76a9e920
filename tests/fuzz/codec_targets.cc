// SPDX-License-Identifier: Apache-2.0
// The decoders of libraries that compressed meshes need, called as core/io calls them.
#include <meshoptimizer.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

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

const FuzzTarget kTargets[] = {{"meshopt", FuzzMeshopt, MeshoptSeeds}};

}  // namespace

std::span<const FuzzTarget> CodecTargets() { return kTargets; }

}  // namespace kdray::fuzz
