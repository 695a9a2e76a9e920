// SPDX-License-Identifier: Apache-2.0
// What a connection reads before anybody is authorised: heads, chunks, content codings, tokens.
#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include "server/bearer_tokens.h"
#include "server/content_decoder.h"
#include "server/http/chunked_framing.h"
#include "server/http/request_head.h"
#include "server/mapping.h"
#include "tests/fuzz/fuzz_target.h"

namespace kdray::fuzz {
namespace {

using server::ChunkedFraming;
using server::ContentCoding;
using server::ContentDecoder;

bool FuzzHead(std::span<const std::byte> input) {
  const std::string_view text = AsText(input);
  const std::size_t end = server::FindHeadEnd(text, 0);
  // Found at the same place when the bytes come one by one.
  std::size_t end_by_bytes = 0;
  for (std::size_t size = 1; end_by_bytes == 0 && size <= text.size(); ++size) {
    end_by_bytes = server::FindHeadEnd(text.substr(0, size), size - 1);
  }
  Require(end == end_by_bytes, "a head ends at one place");
  server::FindOrigin(text);
  if (end == 0) return false;
  const auto parsed = server::ParseRequestHead(text.substr(0, end), {});
  if (const auto* refused = std::get_if<server::RefusedHead>(&parsed)) {
    Require(!refused->problem.detail.empty(), "a problem says what is wrong");
    return false;
  }
  const auto& head = std::get<server::RequestHead>(parsed);
  Require(!head.method.empty(), "a head has a method");
  Require(head.path.starts_with('/') || (head.path == "*" && head.method == "OPTIONS"),
          "a head has a path");
  Require(head.headers.Count("Content-Length") <= 1, "a body has one length");
  Require(!head.chunked || !head.headers.Find("Content-Length"), "a body has one length");
  for (const auto& [name, value] : head.headers.fields()) {
    Require(!name.empty() && std::all_of(value.begin(), value.end(), server::IsFieldValueChar),
            "a field has a name, and no control characters");
  }
  return true;
}

struct Chunks {
  std::string data;
  bool ended = false;
  std::size_t taken = 0;
  friend bool operator==(const Chunks&, const Chunks&) = default;
};

// Reads a chunked body that arrives in pieces of `piece` bytes.
Chunks ReadChunks(std::string_view text, std::size_t piece) {
  ChunkedFraming framing;
  Chunks chunks;
  std::size_t arrived = 0;
  while (framing.next() == ChunkedFraming::Next::kFraming ||
         framing.next() == ChunkedFraming::Next::kData) {
    if (chunks.taken == arrived) {
      if (arrived == text.size()) return chunks;
      arrived = std::min(arrived + piece, text.size());
    }
    const std::string_view rest = text.substr(chunks.taken, arrived - chunks.taken);
    if (framing.next() == ChunkedFraming::Next::kData) {
      const auto count =
          static_cast<std::size_t>(std::min<std::uint64_t>(framing.data_left(), rest.size()));
      chunks.data += rest.substr(0, count);
      framing.TakeData(count);
      chunks.taken += count;
    } else {
      const std::size_t count = framing.Take(rest);
      Require(count <= rest.size(), "no more is taken than is there");
      chunks.taken += count;
    }
  }
  chunks.ended = framing.next() == ChunkedFraming::Next::kEnd;
  Require(chunks.ended || !framing.problem().empty(), "a problem says what is wrong");
  return chunks;
}

bool FuzzChunks(std::span<const std::byte> input) {
  const std::string_view text = AsText(input);
  const Chunks whole = ReadChunks(text, text.size() + 1);
  Require(whole.data.size() <= text.size(), "no data are made up");
  Require(whole == ReadChunks(text, 1) && whole == ReadChunks(text, 7),
          "a body does not depend on how it arrives");
  return whole.ended;
}

// What a coded body decodes to, up to a limit; nullopt for a damaged one. It arrives in pieces of
// `piece` bytes.
std::optional<std::string> Decode(ContentCoding coding, std::span<const std::byte> in,
                                  std::size_t piece) {
  constexpr std::size_t kMost = std::size_t{1} << 20;
  const auto decoder = ContentDecoder::Make(coding);
  std::string text;
  std::size_t taken = 0, arrived = 0;
  std::array<std::byte, 4096> out;
  bool filled = false;
  while (text.size() < kMost) {
    if (!filled) {
      if (taken == in.size() && arrived == in.size()) break;
      arrived = std::min(arrived + piece, in.size());
    }
    const bool is_last = arrived == in.size();
    const auto step = decoder->Decode(in.subspan(taken, arrived - taken), is_last, out);
    if (!step.ok()) return std::nullopt;
    Require(step->taken <= arrived - taken && step->made <= out.size(), "a step stays in bounds");
    taken += step->taken;
    text += AsText(std::span(out).first(step->made));
    filled = step->made == out.size();
    if (is_last && !filled && step->taken == 0 && step->made == 0) break;
  }
  if (text.size() < kMost && !decoder->is_complete()) return std::nullopt;
  text.resize(std::min(text.size(), kMost));
  return text;
}

template <ContentCoding coding>
bool FuzzCoding(std::span<const std::byte> input) {
  const auto whole = Decode(coding, input, input.size() + 1);
  const auto pieces = Decode(coding, input, 13);
  Require(whole == pieces || (whole && whole->size() == std::size_t{1} << 20),
          "a body does not depend on how it arrives");
  return whole.has_value();
}

bool FuzzTokens(std::span<const std::byte> input) {
  const std::string_view text = AsText(input);
  const auto tokens = server::BearerTokens::Parse(text);
  Require(tokens.ok() || !tokens.error().message.empty(), "an error says what is wrong");
  if (tokens.ok()) {
    Require(!tokens->Allows(std::nullopt) && !tokens->Allows("Bearer "), "no token is no token");
    tokens->Allows(text);
  }
  // Texts from links and paths.
  const auto id = server::ToTreeId(text);
  Require(id.ok() || !id.problem().detail.empty(), "a problem says what is wrong");
  const auto position = server::ParseCursor(text);
  return tokens.ok() || id.ok() || position.has_value();
}

std::vector<Bytes> HeadSeeds() {
  return {ToBytes("GET /v1/trees?limit=3 HTTP/1.1\r\nHost: a\r\nAccept: application/json\r\n\r\n"),
          ToBytes("POST /v1/trees HTTP/1.1\r\nHost: a:80\r\nContent-Length: 12\r\n"
                  "Expect: 100-continue\r\nConnection: close\r\n\r\n"),
          ToBytes("POST http://a/v1/trees HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n"
                  "Origin: http://b\r\n\r\n"),
          ToBytes("HEAD / HTTP/1.0\r\nConnection: keep-alive\r\n\r\n")};
}

std::vector<Bytes> ChunkSeeds() {
  return {
      ToBytes("5\r\nhello\r\n0\r\n\r\n"),
      ToBytes("3;name=value\r\nabc\r\n1f\r\n0123456789012345678901234567890\r\n0\r\nA: b\r\n\r\n")};
}

std::vector<Bytes> GzipSeeds() {
  // "hello hello hello", and an empty member.
  const unsigned char hello[] = {0x1f, 0x8b, 8,    0,    0,    0,    0,    0,    2,    3,
                                 0xcb, 0x48, 0xcd, 0xc9, 0xc9, 0x57, 0xc8, 0x40, 0x90, 0,
                                 0x80, 0x88, 0xf9, 0xe5, 0x11, 0,    0,    0};
  const unsigned char empty[] = {0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  const auto bytes = [](const auto& file) {
    const auto view = std::as_bytes(std::span(file));
    return Bytes(view.begin(), view.end());
  };
  return {bytes(hello), bytes(empty)};
}

std::vector<Bytes> ZstdSeeds() {
  // A frame with one raw block, and a skippable frame before one.
  const unsigned char raw[] = {0x28, 0xb5, 0x2f, 0xfd, 0x20, 5,   0x29,
                               0,    0,    'h',  'e',  'l',  'l', 'o'};
  const unsigned char skip[] = {0x50, 0x2a, 0x4d, 0x18, 2, 0, 0, 0, 1, 2};
  Bytes frame, both;
  for (const unsigned char c : skip) both.push_back(static_cast<std::byte>(c));
  for (const unsigned char c : raw) frame.push_back(static_cast<std::byte>(c));
  both.insert(both.end(), frame.begin(), frame.end());
  return {frame, both};
}

std::vector<Bytes> TokenSeeds() {
  return {ToBytes("# tokens\nabc\n\ndef+/=\n"),
          ToBytes("0000000000000000000000000000000000000000000000000000000000000000-kd-sah")};
}

const FuzzTarget kTargets[] = {{"request_head", FuzzHead, HeadSeeds},
                               {"chunks", FuzzChunks, ChunkSeeds},
                               {"gzip", FuzzCoding<ContentCoding::kGzip>, GzipSeeds},
                               {"zstd", FuzzCoding<ContentCoding::kZstd>, ZstdSeeds},
                               {"tokens", FuzzTokens, TokenSeeds}};

}  // namespace

std::span<const FuzzTarget> HttpTargets() { return kTargets; }

}  // namespace kdray::fuzz
