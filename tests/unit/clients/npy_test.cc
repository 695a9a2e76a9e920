// SPDX-License-Identifier: Apache-2.0
#include "kdray/npy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "kdray/error.h"

namespace kdray::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using namespace std::string_literals;

// A version 1 file whose header is this text, padded by nothing.
std::string FileWithHeader(const std::string& text) {
  return "\x93NUMPY\1\0"s + static_cast<char>(text.size() & 255) +
         static_cast<char>(text.size() >> 8) + text;
}

TEST(Npy, ReadsBackTheHeaderThatItWrites) {
  const NpyHeader written = {.descr = "<f8", .fortran_order = true, .shape = {3, 4, 6}};
  const std::string bytes = EncodeNpyHeader(written);
  const NpyHeader read = ParseNpyHeader(bytes);
  EXPECT_EQ(read.descr, "<f8");
  EXPECT_TRUE(read.fortran_order);
  EXPECT_THAT(read.shape, ElementsAre(3u, 4u, 6u));
  EXPECT_EQ(read.data_offset, bytes.size());
  EXPECT_EQ(bytes.size() % 64, 0u);
}

TEST(Npy, WritesRowsAsNumPyWould) {
  const float values[] = {1.0f, -2.0f};
  const std::string bytes =
      EncodeNpyHeader({.descr = "<f4", .shape = {1, 2}}) + LittleEndianFloats(values);
  // numpy.save of numpy.array([[1, -2]], 'f4') except for the comma that NumPy omits.
  EXPECT_THAT(bytes, HasSubstr("{'descr': '<f4', 'fortran_order': False, 'shape': (1,2,), }"));
  EXPECT_EQ(bytes.substr(bytes.size() - 8), "\0\0\x80\x3f\0\0\0\xc0"s);
}

TEST(Npy, ReadsAHeaderThatNumPyWrote) {
  const NpyHeader header = ParseNpyHeader(
      FileWithHeader("{'descr': '<f4', 'fortran_order': False, 'shape': (1000, 6), }      \n"));
  EXPECT_EQ(header.descr, "<f4");
  EXPECT_FALSE(header.fortran_order);
  EXPECT_THAT(header.shape, ElementsAre(1000u, 6u));
  EXPECT_EQ(header.ElementCount(), 6000u);
}

TEST(Npy, ReadsAStructuredTypeAsItsText) {
  const NpyHeader header = ParseNpyHeader(
      FileWithHeader("{'descr': [('t', '<f4'), ('triangle', '<i4')], 'fortran_order': False, "
                     "'shape': (7,), }\n"));
  EXPECT_EQ(header.descr, "[('t', '<f4'), ('triangle', '<i4')]");
  EXPECT_THAT(header.shape, ElementsAre(7u));
}

TEST(Npy, ReadsTheFourByteLengthOfVersion2And3) {
  for (const char version : {'\2', '\3'}) {
    const std::string text = "{'descr': '<f8', 'fortran_order': False, 'shape': (), }\n";
    std::string bytes = "\x93NUMPY"s + version + '\0';
    bytes += {static_cast<char>(text.size()), '\0', '\0', '\0'};
    const NpyHeader header = ParseNpyHeader(bytes + text);
    EXPECT_EQ(header.data_offset, 12 + text.size());
    EXPECT_EQ(header.ElementCount(), 1u);
  }
}

TEST(Npy, SaysWhatIsWrongWithADamagedHeader) {
  const std::string good = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6), }\n";
  const struct {
    std::string bytes;
    const char* reason;
  } kCases[] = {
      {"", "magic"},
      {"PK\3\4 a zip file", "magic"},
      {"\x93NUMPY\1"s, "ends within its header"},
      {"\x93NUMPY\4\0\0\0\0\0"s, "version"},
      {FileWithHeader(good).substr(0, 40), "ends within its header"},
      {FileWithHeader("no dictionary at all"), "lacks a '{'"},
      {FileWithHeader("{'descr': '<f4', 'shape': (2,), }"), "missing"},
      {FileWithHeader("{'descr': '<f4"), "not closed"},
      {FileWithHeader("{'descr': [('t', '<f4'}"), "not closed"},
      {FileWithHeader("{'descr': 4, 'fortran_order': False, 'shape': (2,), }"), "neither a word"},
      {FileWithHeader("{'descr': '<f4', 'fortran_order': 0, 'shape': (2,), }"), "True nor False"},
      {FileWithHeader("{'descr': '<f4', 'fortran_order': False, 'shape': (-2,), }"),
       "not a number"},
      {FileWithHeader("{'descr': '<f4', 'fortran_order': False, 'shape': (2 "), "too early"},
      {FileWithHeader("{'descr': '<f4', 'evil': 'x', }"), "unknown header key"},
  };
  for (const auto& test : kCases) {
    SCOPED_TRACE(test.bytes);
    try {
      ParseNpyHeader(test.bytes);
      ADD_FAILURE() << "accepted";
    } catch (const LocalFileError& error) {
      EXPECT_THAT(error.what(), HasSubstr(test.reason));
    }
  }
}

}  // namespace
}  // namespace kdray::client
