#include "unlidar/output_files.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include "temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;
using ::unlidar::testing::TemporaryFolder;

std::string Content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::set<std::string> FilesIn(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(WriteFiles, CreatesReplacesAndLeavesNothingElse) {
  const TemporaryFolder folder;
  folder.Write("b", "old and longer");
  WriteFiles({{folder / "a", std::string("x\0y", 3)}, {folder / "b", "new"}});
  EXPECT_EQ(Content(folder / "a"), std::string("x\0y", 3));
  EXPECT_EQ(Content(folder / "b"), "new");
  EXPECT_EQ(FilesIn(folder.path()), (std::set<std::string>{"a", "b"}));
}

TEST(WriteFiles, TouchesNoneIfOneCannotBeWritten) {
  const TemporaryFolder folder;
  folder.Write("a", "old");
  for (const std::string& bad : {folder / "none/b", std::string("/dev/full")}) {
    EXPECT_THROW(WriteFiles({{folder / "a", "new"}, {folder / "c", "new"}, {bad, "new"}}),
                 OutputError)
        << bad;
    EXPECT_EQ(Content(folder / "a"), "old") << bad;
    EXPECT_EQ(FilesIn(folder.path()), std::set<std::string>{"a"}) << bad;
  }
}

TEST(WriteFiles, WritesThroughALinkAndKeepsIt) {
  const TemporaryFolder folder;
  folder.Write("real/a", "old");
  fs::create_symlink("real/a", folder / "link");
  WriteFiles({{folder / "link", "new"}});
  EXPECT_TRUE(fs::is_symlink(folder / "link"));
  EXPECT_EQ(Content(folder / "real/a"), "new");
}

TEST(WriteFiles, LeavesADeviceADevice) {
  WriteFiles({{"/dev/null", "gone"}});
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST(CheckWritable, AcceptsNewAndOldFilesAndLeavesNothingBehind) {
  const TemporaryFolder folder;
  folder.Write("old", "content");
  CheckWritable(folder / "new");
  CheckWritable(folder / "old");
  CheckWritable("/dev/null");
  EXPECT_EQ(Content(folder / "old"), "content");
  EXPECT_EQ(FilesIn(folder.path()), std::set<std::string>{"old"});
}

TEST(CheckWritable, RefusesDirectoriesAndMissingOnesByName) {
  const TemporaryFolder folder;
  folder.Write("file", "");
  for (const std::string& path :
       {folder.path(), folder.path() + "/", folder / "none/a", folder / "file/a",
        std::string("/proc/a"), folder / std::string(300, 'a')}) {
    try {
      CheckWritable(path);
      ADD_FAILURE() << path;
    } catch (const OutputError& error) {
      EXPECT_EQ(std::string(error.what()).find(path + ": cannot be written: "), 0U) << error.what();
    }
  }
}

TEST(ResolvedPath, IsTheSameForTwoNamesOfOneFile) {
  const TemporaryFolder folder;
  folder.Write("real/a", "");
  fs::create_directory_symlink("real", folder / "link");
  EXPECT_EQ(ResolvedPath(folder / "link/a"), ResolvedPath(folder / "real/../real/./a"));
  EXPECT_EQ(ResolvedPath(folder / "link/new"), ResolvedPath(folder / "real/new"));
  EXPECT_NE(ResolvedPath(folder / "link/new"), ResolvedPath(folder / "new"));
  EXPECT_EQ(ResolvedPath("new"), ResolvedPath("./new"));
  EXPECT_EQ(ResolvedPath("new"), ResolvedPath(fs::absolute("new").string()));
}

}  // namespace
}  // namespace unlidar
