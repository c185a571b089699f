#include "app/output_files.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>

#include "tests/temporary_folder.hpp"
#include "tests/without_privileges.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;
using ::unlidar::testing::TemporaryFolder;
using ::unlidar::testing::WithoutPrivileges;

std::string BytesOf(const std::string& path) {
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
  WriteFiles({{folder / "a", Content(std::string("x\0y", 3))}, {folder / "b", Content("new")}});
  EXPECT_EQ(BytesOf(folder / "a"), std::string("x\0y", 3));
  EXPECT_EQ(BytesOf(folder / "b"), "new");
  EXPECT_EQ(FilesIn(folder.path()), (std::set<std::string>{"a", "b"}));
}

TEST(WriteFiles, TouchesNoneIfOneCannotBeWritten) {
  const TemporaryFolder folder;
  folder.Write("a", "old");
  for (const std::string& bad : {folder / "none/b", std::string("/dev/full")}) {
    EXPECT_THROW(WriteFiles({{folder / "a", Content("new")},
                             {folder / "c", Content("new")},
                             {bad, Content("new")}}),
                 OutputError)
        << bad;
    EXPECT_EQ(BytesOf(folder / "a"), "old") << bad;
    EXPECT_EQ(FilesIn(folder.path()), std::set<std::string>{"a"}) << bad;
  }
}

TEST(WriteFiles, WritesThroughALinkAndKeepsIt) {
  const TemporaryFolder folder;
  folder.Write("real/a", "old");
  fs::create_symlink("real/a", folder / "link");
  WriteFiles({{folder / "link", Content("new")}});
  EXPECT_TRUE(fs::is_symlink(folder / "link"));
  EXPECT_EQ(BytesOf(folder / "real/a"), "new");
}

TEST(WriteFiles, LeavesADeviceADevice) {
  WriteFiles({{"/dev/null", Content("gone")}});
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST(WriteFiles, KeepsEveryByteOfPiecesOfAnySize) {
  const TemporaryFolder folder;
  std::string expected;
  const ContentWriter pieces = [&](const Sink& sink) {
    for (const std::size_t size : {0U, 1U, 65535U, 3U, 65536U, 200000U, 7U}) {
      const std::string piece(size, static_cast<char>('a' + expected.size() % 26));
      expected += piece;
      sink(piece);
    }
  };
  WriteFiles({{folder / "a", pieces}});
  EXPECT_EQ(BytesOf(folder / "a"), expected);
}

TEST(WriteFiles, LeavesNothingWhereTheContentFails) {
  const TemporaryFolder folder;
  folder.Write("a", "old");
  const ContentWriter fails = [](const Sink& sink) {
    sink(std::string(100'000, 'x'));
    throw std::runtime_error("no more");
  };
  EXPECT_THROW(WriteFiles({{folder / "a", fails}}), std::runtime_error);
  EXPECT_EQ(BytesOf(folder / "a"), "old");
  EXPECT_EQ(FilesIn(folder.path()), std::set<std::string>{"a"});
}

TEST(WriteFiles, MakesWhatALinkToNothingLeadsTo) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "real");
  fs::create_symlink("second", folder / "first");
  fs::create_symlink(folder / "real/../real/a", folder / "second");
  CheckWritable(folder / "first");
  WriteFiles({{folder / "first", Content("new")}});
  EXPECT_TRUE(fs::is_symlink(folder / "first"));
  EXPECT_TRUE(fs::is_symlink(folder / "second"));
  EXPECT_EQ(BytesOf(folder / "real/a"), "new");
  EXPECT_EQ(FilesIn(folder / "real"), std::set<std::string>{"a"});
}

TEST(WriteFiles, RefusesLinksThatLeadNowhere) {
  const TemporaryFolder folder;
  fs::create_symlink("b", folder / "a");
  fs::create_symlink("a", folder / "b");
  fs::create_symlink("none/x", folder / "c");
  for (const char* name : {"a", "b", "c"}) {
    EXPECT_THROW(CheckWritable(folder / name), OutputError) << name;
    EXPECT_THROW(WriteFiles({{folder / name, Content("new")}}), OutputError) << name;
    EXPECT_TRUE(fs::is_symlink(folder / name));
  }
}

mode_t ModeOf(const std::string& path) {
  struct stat status {};
  EXPECT_EQ(::stat(path.c_str(), &status), 0);
  return status.st_mode & 0777;
}

TEST(WriteFiles, HandsOnThePermissionsOfWhatItReplaces) {
  const TemporaryFolder folder;
  for (const mode_t umask : {0022U, 0077U, 0U}) {
    const mode_t before = ::umask(umask);
    for (const mode_t mode : {0600U, 0640U, 0666U, 0444U, 0755U}) {
      folder.Write("old", "old");
      ASSERT_EQ(::chmod((folder / "old").c_str(), mode), 0);
      WriteFiles({{folder / "old", Content("new")}, {folder / "new", Content("new")}});
      EXPECT_EQ(ModeOf(folder / "old"), mode);
      EXPECT_EQ(ModeOf(folder / "new"), 0666 & ~umask);
      EXPECT_EQ(BytesOf(folder / "old"), "new");
      fs::remove(folder / "old");
      fs::remove(folder / "new");
    }
    ::umask(before);
  }
}

TEST(WriteFiles, HandsOnTheOwnerWhereItMayAndNoRightToAnotherGroup) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can make a file of somebody else";
  constexpr uid_t kSomebody = 12345;
  const TemporaryFolder folder;
  const std::string path = folder.Write("a", "old");
  ASSERT_EQ(::chown(path.c_str(), kSomebody, kSomebody), 0);
  ASSERT_EQ(::chmod(path.c_str(), 0664), 0);
  WriteFiles({{path, Content("new")}});
  struct stat status {};
  ASSERT_EQ(::stat(path.c_str(), &status), 0);
  EXPECT_EQ(status.st_uid, kSomebody);
  EXPECT_EQ(status.st_gid, kSomebody);

  ASSERT_EQ(::chmod(folder.path().c_str(), 0777), 0);
  {
    const WithoutPrivileges nobody;
    WriteFiles({{path, Content("newer")}});
  }
  ASSERT_EQ(::stat(path.c_str(), &status), 0);
  EXPECT_NE(status.st_uid, kSomebody);
  EXPECT_EQ(status.st_mode & 0777, 0644U);
  EXPECT_EQ(BytesOf(path), "newer");
}

TEST(WriteFiles, NoNameIsTooLongThatTheSystemTakes) {
  const TemporaryFolder folder;
  const std::string name(255, 'a');
  WriteFiles({{folder / name, Content("new")}});
  EXPECT_EQ(FilesIn(folder.path()), std::set<std::string>{name});
}

// In a container, where the number of the process comes again.
TEST(WriteFiles, WhatADeadRunLeftIsInNobodysWay) {
  const TemporaryFolder folder;
  folder.Write("a.part-" + std::to_string(::getpid()), "");
  const ContentWriter dies = [](const Sink& sink) {
    sink(std::string(100'000, 'x'));
    ::raise(SIGKILL);
  };
  EXPECT_EXIT(WriteFiles({{folder / "a", dies}}), ::testing::KilledBySignal(SIGKILL), "");
  EXPECT_EQ(FilesIn(folder.path()).size(), 2U);
  CheckWritable(folder / "a");
  WriteFiles({{folder / "a", Content("new")}});
  EXPECT_EQ(BytesOf(folder / "a"), "new");
  EXPECT_EQ(FilesIn(folder.path()).size(), 3U);
}

TEST(WriteFiles, ASignalThatEndsTheProcessLeavesNothing) {
  const TemporaryFolder folder;
  folder.Write("b", "old");
  for (const int signal : {SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU}) {
    const ContentWriter dies = [signal](const Sink& sink) {
      sink(std::string(100'000, 'x'));
      const rlimit no_core{0, 0};
      ::setrlimit(RLIMIT_CORE, &no_core);
      ::raise(signal);
    };
    EXPECT_EXIT(WriteFiles({{folder / "a", Content("new")}, {folder / "b", dies}}),
                ::testing::KilledBySignal(signal), "");
    EXPECT_EQ(BytesOf(folder / "b"), "old");
    EXPECT_EQ(FilesIn(folder.path()), std::set<std::string>{"b"});
  }
}

volatile std::sig_atomic_t num_handled = 0;

TEST(WriteFiles, ASignalThatIsIgnoredOrHandledKeepsItsMeaning) {
  const TemporaryFolder folder;
  std::signal(SIGHUP, SIG_IGN);  // as nohup does
  std::signal(SIGTERM, [](int) { num_handled = num_handled + 1; });
  const ContentWriter signalled = [](const Sink& sink) {
    sink("new");
    ::raise(SIGHUP);
    ::raise(SIGTERM);
  };
  WriteFiles({{folder / "a", signalled}, {folder / "b", Content("new")}});
  EXPECT_EQ(num_handled, 1);
  EXPECT_EQ(BytesOf(folder / "a"), "new");
  EXPECT_EQ(std::signal(SIGHUP, SIG_DFL), SIG_IGN);
  EXPECT_NE(std::signal(SIGTERM, SIG_DFL), SIG_DFL);
  EXPECT_EQ(std::signal(SIGINT, SIG_DFL), SIG_DFL);  // as it was before
}

TEST(CheckWritable, AcceptsNewAndOldFilesAndLeavesNothingBehind) {
  const TemporaryFolder folder;
  folder.Write("old", "content");
  CheckWritable(folder / "new");
  CheckWritable(folder / "old");
  CheckWritable("/dev/null");
  EXPECT_EQ(BytesOf(folder / "old"), "content");
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
  fs::create_symlink("real/none", folder / "to_nothing");
  EXPECT_EQ(ResolvedPath(folder / "to_nothing"), ResolvedPath(folder / "real/none"));
  EXPECT_EQ(ResolvedPath("new"), ResolvedPath("./new"));
  EXPECT_EQ(ResolvedPath("new"), ResolvedPath(fs::absolute("new").string()));
}

}  // namespace
}  // namespace unlidar
