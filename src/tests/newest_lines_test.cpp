#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "app/growing_file.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

using ::unlidar::testing::TemporaryFolder;

std::string Content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

struct Output {
  explicit Output(const std::string& path)
      : lines(path, [this](const std::string& note) { notes.push_back(note); }) {}

  std::vector<std::string> notes;
  NewestLines lines;
};

ino_t InodeOf(const std::string& path) {
  struct stat status {};
  EXPECT_EQ(::stat(path.c_str(), &status), 0);
  return status.st_ino;
}

TEST(NewestLines, AFileGrowsUpToItsBoundAndANewOneTakesItsPlace) {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/lines";
  std::ofstream(path) << "of an earlier run\n";
  Output output(path);
  EXPECT_EQ(Content(path), "");
  std::ifstream reader(path, std::ios::binary);  // of the first file
  const std::string line = std::string(9'999, 'x') + "\n";
  const std::size_t fit = NewestLines::kMaxBytes / line.size();
  for (std::size_t i = 0; i < fit; ++i) output.lines.Append(line);
  EXPECT_EQ(fs::file_size(path), fit * line.size());
  const ino_t first = InodeOf(path);
  output.lines.Append("next\n");
  EXPECT_EQ(InodeOf(path), first) << "a short line still fits";
  output.lines.Append(line);
  EXPECT_NE(InodeOf(path), first);
  EXPECT_EQ(Content(path), line);
  const std::string read{std::istreambuf_iterator<char>(reader), {}};
  EXPECT_EQ(read.size(), fit * line.size() + 5) << "who has it open misses nothing";
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
  EXPECT_TRUE(output.notes.empty());
}

TEST(NewestLines, WhatCannotBeWrittenIsNotedOnceAndLeavesNoTornLine) {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/lines";
  Output output(path);
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit old{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const rlimit full{10, old.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &full), 0);
  for (int i = 0; i < 3; ++i) output.lines.Append("a line that is longer\n");
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &old), 0);
  ASSERT_EQ(output.notes.size(), 1U);
  EXPECT_NE(output.notes.front().find(path + ": cannot be written: "), std::string::npos);
  output.lines.Append("after it\n");
  EXPECT_EQ(Content(path), "after it\n");
  EXPECT_EQ(output.notes.size(), 1U);
}

TEST(NewestLines, ALinkStaysOne) {
  const TemporaryFolder folder;
  const std::string link = folder.path() + "/link";
  fs::create_symlink(folder.path() + "/lines", link);
  Output(link).lines.Append("line\n");
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(Content(folder.path() + "/lines"), "line\n");
}

TEST(NewestLines, AFolderThatIsNotThereIsAnError) {
  const TemporaryFolder folder;
  EXPECT_THROW(Output(folder.path() + "/absent/lines"), OutputError);
}

}  // namespace
}  // namespace unlidar
