// SPDX-License-Identifier: Apache-2.0
#include "kdray/payload.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "kdray/error.h"
#include "tests/support/temporary_folder.h"

namespace kdray::client {
namespace {

using test::TemporaryFolder;
using test::WriteText;

std::string TextOf(const Payload& payload) {
  std::string text(payload.size(), '\0');
  payload.Read(0, text);
  return text;
}

TEST(Payload, JoinsPiecesOfFilesAndMemory) {
  const TemporaryFolder folder;
  WriteText(folder / "a", "0123456789");
  const Payload joined =
      Payload::Join({Payload::OfBytes("memory", "head "), Payload::OfFile(folder / "a").Part(2, 5),
                     Payload::OfBytes("", ""), Payload::OfBytes("tail", " tail")});
  EXPECT_EQ(TextOf(joined), "head 23456 tail");
  EXPECT_EQ(joined.name(), "memory");
  EXPECT_EQ(TextOf(joined.Part(3, 4)), "d 23");
  EXPECT_EQ(TextOf(joined.Part(15, 0)), "");
  std::string middle(3, '\0');
  joined.Read(9, middle);
  EXPECT_EQ(middle, "6 t");
}

TEST(Payload, HashesAllItsBytes) {
  // FIPS 180-2, appendix B.1.
  const std::string digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  EXPECT_EQ(Payload::OfBytes("", "abc").Sha256(), digest);
  EXPECT_EQ(Payload::Join({Payload::OfBytes("", "a"), Payload::OfBytes("", "bc")}).Sha256(),
            digest);
}

TEST(Payload, ContentDigestIsTheHashInBase64) {
  // RFC 9530, appendix B.1: the SHA-256 of the 19 bytes {"hello": "world"} and a line feed.
  const std::string sha256 = Payload::OfBytes("", "{\"hello\": \"world\"}\n").Sha256();
  EXPECT_EQ(ContentDigest(sha256), "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:");
  EXPECT_THROW(ContentDigest(""), UsageError);
  EXPECT_THROW(ContentDigest(sha256 + "00"), UsageError);
  EXPECT_THROW(ContentDigest(std::string(63, '0') + "g"), UsageError);
  EXPECT_THROW(ContentDigest(std::string(62, '0') + "-1"), UsageError);
}

TEST(Payload, KeepsReadingTheFileThatItHasOpened) {
  const TemporaryFolder folder;
  WriteText(folder / "a", "old");
  const Payload payload = Payload::OfFile(folder / "a");
  std::filesystem::remove(folder / "a");
  WriteText(folder / "a", "new");
  EXPECT_EQ(TextOf(payload), "old");
}

TEST(Payload, ReportsAFileThatBecameShorter) {
  const TemporaryFolder folder;
  WriteText(folder / "a", "0123456789");
  const Payload payload = Payload::OfFile(folder / "a");
  std::filesystem::resize_file(folder / "a", 4);
  EXPECT_THROW(TextOf(payload), LocalFileError);
}

}  // namespace
}  // namespace kdray::client
