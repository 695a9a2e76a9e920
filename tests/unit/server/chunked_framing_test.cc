// SPDX-License-Identifier: Apache-2.0
#include "server/http/chunked_framing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/seed.h"

namespace kdray::server {
namespace {

using Next = ChunkedFraming::Next;

struct Decoded {
  Next end = Next::kFraming;
  std::string data, rest;  ///< the bytes of the chunks; what follows the body
};

/// Decodes `body`, handed over in pieces of at most `piece_bytes`.
Decoded Decode(std::string_view body, std::size_t piece_bytes = std::string_view::npos) {
  ChunkedFraming framing;
  Decoded decoded;
  while (!body.empty() || framing.next() == Next::kEnd) {
    const std::string_view piece = body.substr(0, piece_bytes);
    std::size_t taken = 0;
    switch (framing.next()) {
      case Next::kFraming:
        taken = framing.Take(piece);
        break;
      case Next::kData:
        taken =
            static_cast<std::size_t>(std::min<std::uint64_t>(piece.size(), framing.data_left()));
        decoded.data += piece.substr(0, taken);
        framing.TakeData(taken);
        break;
      case Next::kEnd:
      case Next::kInvalid:
        decoded.end = framing.next();
        decoded.rest = body;
        return decoded;
    }
    body.remove_prefix(taken);
  }
  decoded.end = framing.next();
  return decoded;
}

TEST(ChunkedFraming, JoinsTheDataOfTheChunksAndKeepsWhatFollows) {
  const std::string body =
      "5\r\nhello\r\n1;name=\"x y\"\r\n \r\n00F\r\nworld, 15 bytes\r\n0\r\n\r\nGET /";
  for (const std::size_t piece : {std::size_t{1}, std::size_t{2}, std::size_t{7}, body.size()}) {
    const Decoded decoded = Decode(body, piece);
    EXPECT_EQ(decoded.end, Next::kEnd) << piece;
    EXPECT_EQ(decoded.data, "hello world, 15 bytes");
    EXPECT_EQ(decoded.rest, "GET /");
  }
}

TEST(ChunkedFraming, TakesTheEmptyBodyAndIgnoresTrailers) {
  EXPECT_EQ(Decode("0\r\n\r\n").end, Next::kEnd);
  EXPECT_EQ(Decode("0000000000000000;x\r\n\r\n").end, Next::kEnd);
  const Decoded decoded =
      Decode("1\r\na\r\n0\r\nContent-Length: 5\r\nTransfer-Encoding: gzip\r\nX:\r\n\r\nrest");
  EXPECT_EQ(decoded.end, Next::kEnd);
  EXPECT_EQ(decoded.data, "a");
  EXPECT_EQ(decoded.rest, "rest");
}

TEST(ChunkedFraming, RefusesSizesThatTwoReadersCouldUnderstandDifferently) {
  for (const char* line : {"",
                           " ",
                           " 5",
                           "5 ",
                           "5\t",
                           "5 ;x",
                           "+5",
                           "-5",
                           "-0",
                           "0x5",
                           "0X5",
                           "x",
                           "g",
                           "5.",
                           "5,5",
                           "5h",
                           "\"5\"",
                           "5\r5",
                           "5\v",
                           "\xd9\xa5",
                           "00000000000000005",
                           "11111111111111111"}) {
    EXPECT_EQ(Decode(std::string(line) + "\r\nhello\r\n0\r\n\r\n").end, Next::kInvalid)
        << "'" << line << "'";
  }
}

TEST(ChunkedFraming, KnowsEverySizeOf64Bits) {
  ChunkedFraming framing;
  framing.Take("fFfFfFfFfFfFfFfF\r\n");
  EXPECT_EQ(framing.next(), Next::kData);
  EXPECT_EQ(framing.data_left(), 0xffffffffffffffffU);
  EXPECT_EQ(Decode("00000000000000001\r\na\r\n0\r\n\r\n").end, Next::kInvalid);
  EXPECT_EQ(Decode("0000000000000001\r\na\r\n0\r\n\r\n").end, Next::kEnd);
}

TEST(ChunkedFraming, WantsCrLfAtTheEndOfEveryLine) {
  for (const char* body :
       {"5\nhello\r\n0\r\n\r\n", "5\r\nhello\n0\r\n\r\n", "5\r\nhello\r0\r\n\r\n",
        "5\rhello\r\n0\r\n\r\n", "5\r\nhello0\r\n\r\n", "5\r\nhello!\r\n0\r\n\r\n",
        "5\r\nhello\r\n0\n\r\n", "5\r\nhello\r\n0\r\n\n", "0\r\nX: y\n\r\n", "0\r\nX: y\r\r\n\r\n",
        "0\r\n\rX: y\r\n\r\n", "5;a\nhello\r\n0\r\n\r\n", "5;a\r\r\nhello\r\n0\r\n\r\n",
        "5\r\r\nhello\r\n0\r\n\r\n", "0;\x01\r\n\r\n", "\r\n0\r\n\r\n"}) {
    EXPECT_EQ(Decode(body).end, Next::kInvalid) << body;
    EXPECT_EQ(Decode(body, 1).end, Next::kInvalid) << body;
  }
}

TEST(ChunkedFraming, RefusesTrailersThatAreNoHeaderFields) {
  for (const char* line :
       {"no colon", ": no name", "X : y", " folded", "\tfolded: x", "X: a\x7f"}) {
    EXPECT_EQ(Decode("0\r\nA: b\r\n" + std::string(line) + "\r\n\r\n").end, Next::kInvalid) << line;
  }
}

TEST(ChunkedFraming, LimitsExtensionsOfAChunkAndAllTrailers) {
  const auto with_extension = [](std::size_t bytes) {
    const std::string extension = ";" + std::string(bytes - 1, 'x') + "\r\n";
    return "1" + extension + "a\r\n1" + extension + "b\r\n0" + extension + "\r\n";
  };
  EXPECT_EQ(Decode(with_extension(4096)).end, Next::kEnd);
  EXPECT_EQ(Decode(with_extension(4096)).data, "ab");
  EXPECT_EQ(Decode(with_extension(4097)).end, Next::kInvalid);
  const auto with_trailers = [](std::size_t bytes) {
    const std::string first = "A: b\r\n";
    return "0\r\n" + first + "X: " + std::string(bytes - first.size() - 5, 'y') + "\r\n\r\n";
  };
  EXPECT_EQ(Decode(with_trailers(8192)).end, Next::kEnd);
  EXPECT_EQ(Decode(with_trailers(8193)).end, Next::kInvalid);
  // Lines that never end.
  EXPECT_EQ(Decode("0\r\n" + std::string(100'000, 'x')).end, Next::kInvalid);
  EXPECT_EQ(Decode("1;" + std::string(100'000, 'x')).end, Next::kInvalid);
}

TEST(ChunkedFraming, DecodesWhatWasEncodedHoweverItIsCut) {
  std::mt19937_64 random(test::Seed());
  for (int round = 0; round < 200; ++round) {
    std::string data, body;
    for (std::uint64_t chunks = random() % 20; chunks > 0; --chunks) {
      const std::string chunk(1 + random() % 40, static_cast<char>('a' + random() % 26));
      char size[32];
      std::snprintf(size, sizeof(size), random() % 2 == 0 ? "%zx" : "%08zX", chunk.size());
      data += chunk;
      body +=
          size + std::string(random() % 3 == 0 ? ";e=\"\xc3\xa4\"" : "") + "\r\n" + chunk + "\r\n";
    }
    body += "0\r\n" + std::string(random() % 2 == 0 ? "T: x\r\n" : "") + "\r\n";
    const Decoded decoded = Decode(body + "next", 1 + random() % 9);
    EXPECT_EQ(decoded.end, Next::kEnd);
    EXPECT_EQ(decoded.data, data);
    EXPECT_EQ(decoded.rest, "next");
    // Every proper beginning is incomplete, never complete and never malformed.
    EXPECT_EQ(Decode(body.substr(0, random() % body.size())).end == Next::kEnd, false);
    EXPECT_NE(Decode(body.substr(0, random() % body.size())).end, Next::kInvalid);
  }
}

}  // namespace
}  // namespace kdray::server
