#include "io/input_file.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <csignal>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::TemporaryFolder;

const InputKind kAny{"text"};
const InputKind kRegular{"text", true};

std::vector<std::string> LinesOf(const std::string& bytes) {
  const TemporaryFolder folder;
  LineReader reader(folder.Write("file", bytes), kAny);
  std::vector<std::string> lines;
  while (reader.Next()) {
    lines.emplace_back(reader.line());
    EXPECT_EQ(reader.number(), lines.size());
  }
  return lines;
}

template <class Action>
std::string ReasonOf(const Action& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

TEST(LineReader, GivesTheLinesOfGetline) {
  std::string bytes;
  for (std::size_t i = 0; i < 3000; ++i) bytes += std::string(i % 157, 'x') + "\n";
  bytes += std::string(65'536, 'y') + "\n\n" + std::string("z\0z", 3);
  for (const std::string& text : {bytes, bytes + "\n", bytes.substr(0, 65'537), std::string("\n"),
                                  std::string("a"), std::string()}) {
    std::vector<std::string> expected;
    std::istringstream stream(text);
    for (std::string line; std::getline(stream, line);) expected.push_back(line);
    EXPECT_EQ(LinesOf(text), expected);
  }
}

TEST(LineReader, EndsForEveryEndlessFile) {
  std::signal(SIGPIPE, SIG_IGN);
  const TemporaryFolder folder;
  const auto read_all = [](const std::string& path) {
    LineReader reader(path, kAny);
    while (reader.Next()) {
    }
  };
  EXPECT_EQ(ReasonOf([&] { read_all("/dev/zero"); }),
            "/dev/zero:1: more than 65536 bytes in a line, expected fewer");
  for (const auto& [line, expected] :
       {std::pair<std::string, std::string>{"\n", "more than 10000000 lines, expected fewer"},
        {std::string(60'000, '#') + "\n", "more than 1073741824 bytes, expected fewer"}}) {
    const std::string pipe = folder / std::to_string(line.size());
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
    std::string block;
    while (block.size() < 1'000'000) block += line;
    std::thread writer([&] {  // until the reader has enough
      const Descriptor out(::open(pipe.c_str(), O_WRONLY));
      while (::write(out.get(), block.data(), block.size()) > 0) {
      }
    });
    EXPECT_EQ(ReasonOf([&] { read_all(pipe); }), pipe + ": " + expected);
    writer.join();
  }
}

TEST(ReadWhole, GivesAllBytesUpToTheLimit) {
  const TemporaryFolder folder;
  const std::string bytes("a\0b\n", 4);
  const std::string path = folder.Write("file", bytes);
  EXPECT_EQ(ReadWhole(path, kAny, 4), bytes);
  EXPECT_EQ(ReasonOf([&] { ReadWhole(path, kAny, 3); }),
            path + ": more than 3 bytes, expected fewer");
  EXPECT_EQ(ReasonOf([&] { ReadWhole("/dev/zero", kAny, 10); }),
            "/dev/zero: more than 10 bytes, expected fewer");
}

TEST(InputFile, NamesWhatCannotBeRead) {
  const TemporaryFolder folder;
  EXPECT_EQ(ReasonOf([&] { ReadWhole(folder / "none", kAny, 9); }),
            (folder / "none") + ": cannot be read (No such file or directory), expected text");
  EXPECT_EQ(ReasonOf([&] { ReadWhole(folder.path(), kAny, 9); }),
            folder.path() + ": cannot be read (Is a directory), expected text");
  // Opens, and gives an error instead of its first byte.
  EXPECT_EQ(ReasonOf([&] { ReadWhole("/proc/self/mem", kAny, 9); }),
            "/proc/self/mem: cannot be read (Input/output error), expected text");
  EXPECT_EQ(ReasonOf([&] { LineReader("/proc/self/mem", kAny).Next(); }),
            "/proc/self/mem: cannot be read (Input/output error), expected text");
}

TEST(InputFile, APipeWithoutAWriterIsRefusedAtOnceWhereAFileMustBeRegular) {
  const TemporaryFolder folder;
  const std::string pipe = folder / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  for (const std::string& path : {pipe, folder.path(), std::string("/dev/zero")}) {
    EXPECT_EQ(ReasonOf([&] { InputFile(path, kRegular); }),
              path + ": cannot be read (not a regular file), expected text");
  }
}

}  // namespace
}  // namespace unlidar
