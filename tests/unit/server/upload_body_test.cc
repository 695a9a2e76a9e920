// SPDX-License-Identifier: Apache-2.0
// Uploads with a Content-Encoding, without a socket. Streams are made by zlib and libzstd.
#include "server/upload_body.h"

#include <gtest/gtest.h>
#include <zlib.h>
#include <zstd.h>

#include <functional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/fake_peer.h"
#include "tests/support/seed.h"

namespace kdray::server {
namespace {

using api::ErrorCode;

std::string Gzip(std::string_view data, int level = 6) {
  z_stream stream{};
  deflateInit2(&stream, level, Z_DEFLATED, MAX_WBITS + 16, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, data.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data.data()));
  stream.avail_in = static_cast<uInt>(data.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

std::string Zstd(std::string_view data, int level = 3, int window_log = 0) {
  ZSTD_CCtx* context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
  if (window_log != 0) {
    // Streams do not know their length, so the window is not cut down to it.
    ZSTD_CCtx_setParameter(context, ZSTD_c_windowLog, window_log);
    ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 0);
  }
  std::string out(ZSTD_compressBound(data.size()) + 1000, '\0');
  ZSTD_outBuffer output{out.data(), out.size(), 0};
  ZSTD_inBuffer input{data.data(), data.size(), 0};
  while (input.pos < input.size) ZSTD_compressStream2(context, &output, &input, ZSTD_e_continue);
  ZSTD_compressStream2(context, &output, &input, ZSTD_e_end);
  ZSTD_freeCCtx(context);
  out.resize(output.pos);
  return out;
}

std::string Skippable(std::string_view content) {
  std::string frame("\x5a\x2a\x4d\x18", 4);
  for (int i = 0; i < 4; ++i) frame += static_cast<char>(content.size() >> (8 * i));
  return frame + std::string(content);
}

std::string Random(std::size_t bytes) {
  std::mt19937_64 random(test::Seed());
  std::string data(bytes, '\0');
  for (char& c : data) c = static_cast<char>(random());
  return data;
}

/// Text that a compressor makes some five times smaller.
std::string MeshText(std::size_t bytes) {
  std::mt19937_64 random(test::Seed());
  std::string text;
  while (text.size() < bytes) text += "v 0." + std::to_string(random() % 1000) + " 1.5 -2.25\n";
  text.resize(bytes);
  return text;
}

struct Result {
  std::string data;
  std::optional<ErrorCode> problem;
};

class UploadBodyTest : public testing::Test {
 protected:
  Result Read(std::string body, std::optional<ContentCoding> coding,
              std::size_t piece_bytes = 10'000) {
    test::FakePeer peer(std::move(body));
    if (is_chunked_) peer.DeclareNothing();
    UploadBody upload(&peer, &memory_, coding, max_bytes_);
    Result result;
    std::vector<std::byte> piece(piece_bytes);
    for (;;) {
      const auto count = upload.Read(piece);
      if (!count) {
        result.problem = count.problem().code;
        return result;
      }
      if (*count == 0) return result;
      result.data.append(reinterpret_cast<const char*>(piece.data()), *count);
    }
  }

  RequestMemory memory_{std::uint64_t{64} << 20};
  std::uint64_t max_bytes_ = std::uint64_t{1} << 30;
  bool is_chunked_ = false;
};

struct Coding {
  ContentCoding coding;
  std::function<std::string(std::string_view)> encode;
};
const std::vector<Coding>& Codings() {
  static const std::vector<Coding> codings = {
      {ContentCoding::kGzip, [](std::string_view data) { return Gzip(data); }},
      {ContentCoding::kZstd, [](std::string_view data) { return Zstd(data); }}};
  return codings;
}

TEST_F(UploadBodyTest, WithoutACodingPassesThrough) {
  const std::string data = Random(100'000);
  EXPECT_EQ(Read(data, std::nullopt).data, data);
}

TEST_F(UploadBodyTest, DecodesToTheBytesThatWereEncoded) {
  for (const auto& [coding, encode] : Codings()) {
    for (const std::string& data : {std::string("v 0 0 0\n"), MeshText(1'000'000), Random(700'000),
                                    std::string(1'000'000, '\0'), MeshText(12'000'000)}) {
      for (const bool is_chunked : {false, true}) {
        is_chunked_ = is_chunked;
        const Result result =
            Read(encode(data), coding, data.size() > 2'000'000 ? 256 * 1024 : 10'007);
        EXPECT_FALSE(result.problem);
        EXPECT_TRUE(result.data == data) << data.size();
      }
    }
    EXPECT_EQ(Read(encode("abc"), coding, 1).data, "abc");  // no room for more than a byte
    EXPECT_TRUE(Read(encode(MeshText(300'000)), coding, 3).data == MeshText(300'000));
    EXPECT_EQ(Read(encode(""), coding).data, "");
    EXPECT_FALSE(Read(encode(""), coding).problem);
  }
}

TEST_F(UploadBodyTest, JoinsMembersAndFramesAndSkipsWhatIsToBeSkipped) {
  for (const auto& [coding, encode] : Codings()) {
    const std::string data = MeshText(200'000);
    const std::string joined = encode(data) + encode("") + encode("tail") + encode(data);
    EXPECT_TRUE(Read(joined, coding).data == data + "tail" + data);
  }
  const std::string frames = Skippable("remark") + Zstd("mesh") + Skippable("") + Zstd("more") +
                             Skippable(std::string(300'000, 'x'));
  EXPECT_EQ(Read(frames, ContentCoding::kZstd).data, "meshmore");
  EXPECT_FALSE(Read(frames, ContentCoding::kZstd).problem);
  // A frame's first bytes stand on both sides of the border between two pieces of input.
  for (std::size_t gap = UploadBody::kEncodedPieceBytes - 12; gap <= UploadBody::kEncodedPieceBytes;
       ++gap) {
    const std::string body = Skippable(std::string(gap - 8, 'x')) + Zstd("mesh");
    EXPECT_EQ(Read(body, ContentCoding::kZstd).data, "mesh") << gap;
  }
}

TEST_F(UploadBodyTest, RefusesAStreamThatIsCut) {
  for (const auto& [coding, encode] : Codings()) {
    const std::string whole = encode(MeshText(3000));
    for (std::size_t bytes = 1; bytes < whole.size(); ++bytes) {
      ASSERT_EQ(Read(whole.substr(0, bytes), coding).problem, ErrorCode::kMalformedRequest)
          << bytes;
    }
    const std::string second = whole + whole;
    EXPECT_EQ(Read(second.substr(0, second.size() - 1), coding).problem,
              ErrorCode::kMalformedRequest);
  }
}

TEST_F(UploadBodyTest, RefusesDamagedStreamsAndWhatFollowsTheirEnd) {
  for (const auto& [coding, encode] : Codings()) {
    const std::string data = MeshText(3000);
    const std::string whole = encode(data);
    int refused = 0;
    for (std::size_t i = 0; i < whole.size(); ++i) {
      std::string damaged = whole;
      damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
      const Result result = Read(damaged, coding);
      // Some bits of the header mean nothing; the others are checked.
      if (!result.problem) {
        EXPECT_TRUE(result.data == data) << i;
      }
      refused += result.problem ? 1 : 0;
    }
    EXPECT_GT(refused, static_cast<int>(whole.size()) * 9 / 10);
    for (const std::string& garbage :
         {std::string("x"), std::string(1, '\0'), std::string(1000, '\0'), std::string("\r\n"),
          std::string("\x1f"), std::string("\x28\xb5"), std::string("garbage")}) {
      EXPECT_EQ(Read(whole + garbage, coding).problem, ErrorCode::kMalformedRequest) << garbage;
    }
    EXPECT_EQ(Read(data, coding).problem, ErrorCode::kMalformedRequest);
  }
  EXPECT_EQ(Read(Zstd("x"), ContentCoding::kGzip).problem, ErrorCode::kMalformedRequest);
  EXPECT_EQ(Read(Gzip("x"), ContentCoding::kZstd).problem, ErrorCode::kMalformedRequest);
  // A frame of zstd 0.7, which libzstd could read.
  EXPECT_EQ(Read(std::string("\x27\xb5\x2f\xfd\x00\x00\x00\x00\x00\x00", 10), ContentCoding::kZstd)
                .problem,
            ErrorCode::kMalformedRequest);
}

TEST_F(UploadBodyTest, LimitsTheDecodedBytes) {
  const std::string data = MeshText(50'000);
  for (const auto& [coding, encode] : Codings()) {
    max_bytes_ = data.size();
    EXPECT_TRUE(Read(encode(data), coding).data == data);
    max_bytes_ = data.size() - 1;
    EXPECT_EQ(Read(encode(data), coding).problem, ErrorCode::kMeshTooLarge);
  }
  max_bytes_ = data.size() - 1;
  is_chunked_ = true;
  EXPECT_EQ(Read(data, std::nullopt).problem, ErrorCode::kMeshTooLarge);
}

TEST_F(UploadBodyTest, LimitsTheEncodedBytesToo) {
  max_bytes_ = 100'000;
  std::string nothing;
  while (nothing.size() < 300'000) nothing += Gzip("");
  EXPECT_EQ(Read(nothing, ContentCoding::kGzip).problem, ErrorCode::kMeshTooLarge);
  EXPECT_EQ(Read(Skippable(std::string(300'000, 'x')), ContentCoding::kZstd).problem,
            ErrorCode::kMeshTooLarge);
  test::FakePeer peer;
  peer.Declare(300'000);
  EXPECT_TRUE(UploadBody(&peer, &memory_, ContentCoding::kGzip, max_bytes_).CheckDeclared());
  EXPECT_FALSE(peer.was_read());
  // What cannot be compressed gets a little larger.
  const std::string data = Random(100'000);
  EXPECT_GT(Gzip(data).size(), data.size());
  EXPECT_TRUE(Read(Gzip(data), ContentCoding::kGzip).data == data);
}

TEST_F(UploadBodyTest, RefusesMoreThan200TimesTheEncodedSizeAndAMebibyte) {
  for (const auto& [coding, encode] : Codings()) {
    EXPECT_EQ(Read(encode(std::string(64 << 20, '\0')), coding).problem, ErrorCode::kMeshTooLarge);
  }
  // The first frame alone would be too much, the whole body is exactly at the limit.
  const std::string zeros = Zstd(std::string(3 << 20, '\0'));
  const auto allowed = [](std::size_t encoded) { return encoded * 200 + (1 << 20); };
  std::size_t padding = 0;
  while (allowed(zeros.size() + 8 + padding) < 3 << 20) ++padding;
  const std::string body = zeros + Skippable(std::string(padding, 'x'));
  EXPECT_FALSE(Read(body, ContentCoding::kZstd).problem);
  EXPECT_EQ(Read(zeros + Skippable(std::string(padding - 1, 'x')), ContentCoding::kZstd).problem,
            ErrorCode::kMeshTooLarge);
}

TEST_F(UploadBodyTest, BoundsTheWindowOfZstd) {
  const std::string data = MeshText(100'000);
  EXPECT_TRUE(Read(Zstd(data, 3, 23), ContentCoding::kZstd).data == data);
  EXPECT_EQ(Read(Zstd(data, 3, 24), ContentCoding::kZstd).problem, ErrorCode::kUnsupportedEncoding);
  EXPECT_EQ(Read(Zstd(data, 3, 27), ContentCoding::kZstd).problem, ErrorCode::kUnsupportedEncoding);
}

TEST_F(UploadBodyTest, ChargesTheMemoryForDecodingAsBytesAreDecoded) {
  const std::string body = Zstd(MeshText(9'000'000));
  test::FakePeer peer(body);
  UploadBody upload(&peer, &memory_, ContentCoding::kZstd, max_bytes_);
  std::vector<std::byte> piece(256 * 1024);
  EXPECT_EQ(memory_.used(), 0U);
  std::uint64_t last = 0;
  while (*upload.Read(piece) > 0) {
    EXPECT_GE(memory_.used(), last);
    last = memory_.used();
  }
  EXPECT_GT(last, ContentDecoder::kMaxWindowBytes);
  EXPECT_LT(last, ContentDecoder::kMaxWindowBytes + (1 << 20));
  // Another request holds the rest.
  const auto held = memory_.Take((std::uint64_t{55} << 20) - last, ErrorCode::kMeshTooLarge);
  EXPECT_EQ(Read(body, ContentCoding::kZstd).problem, ErrorCode::kMemoryFull);
}

}  // namespace
}  // namespace kdray::server
