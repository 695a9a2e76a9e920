// SPDX-License-Identifier: Apache-2.0
#include "clients/cpp/command/output_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include "kdray/error.h"
#include "tests/support/temporary_folder.h"

namespace kdray::client {
namespace {

using test::ReadText;
using test::TemporaryFolder;
using test::WriteText;

class OutputFileTest : public ::testing::Test {
 protected:
  std::size_t FilesInFolder() const {
    return static_cast<std::size_t>(
        std::distance(std::filesystem::directory_iterator(folder_.path()), {}));
  }

  TemporaryFolder folder_;
  std::ostringstream out_;
  std::ostringstream err_;
  Console console_ = {.out = out_, .err = err_};
};

TEST_F(OutputFileTest, AppearsUnderItsNameWhenCommittedAndNotBefore) {
  const std::string path = folder_ / "a.png";
  OutputFile file(path, console_);
  file.Write("one ");
  file.Write("two");
  EXPECT_FALSE(std::filesystem::exists(path));
  file.Commit();
  EXPECT_EQ(ReadText(path), "one two");
  EXPECT_EQ(FilesInFolder(), 1u);
}

TEST_F(OutputFileTest, LeavesNothingAndKeepsTheOldFileWithoutCommit) {
  const std::string path = folder_ / "a.png";
  WriteText(path, "old");
  {
    OutputFile file(path, console_);
    file.Write("new");
  }
  EXPECT_EQ(ReadText(path), "old");
  EXPECT_EQ(FilesInFolder(), 1u);
}

TEST_F(OutputFileTest, HasTheModeThatTheUmaskLeaves) {
  const std::string path = folder_ / "a.png";
  const mode_t before = umask(027);
  OutputFile file(path, console_);
  file.Commit();
  umask(before);
  struct stat status {};
  ASSERT_EQ(stat(path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0640u);
}

TEST_F(OutputFileTest, TellsBeforeAnyWorkThatTheFolderIsMissing) {
  EXPECT_THROW(OutputFile(folder_ / "missing/a.png", console_), LocalFileError);
}

TEST_F(OutputFileTest, WritesToWhatIsNoRegularFileDirectly) {
  OutputFile file("/dev/null", console_);
  file.Write("gone");
  file.Commit();
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
}

TEST_F(OutputFileTest, ReportsAFullDisk) {
  OutputFile file("/dev/full", console_);
  EXPECT_THROW(file.Write("x"), LocalFileError);
}

TEST_F(OutputFileTest, MinusIsStandardOutputUnlessThatIsATerminal) {
  OutputFile file("-", console_);
  file.Write("bytes");
  file.Commit();
  EXPECT_EQ(out_.str(), "bytes");
  console_.out_is_terminal = true;
  EXPECT_THROW(OutputFile("-", console_), LocalFileError);
}

}  // namespace
}  // namespace kdray::client
