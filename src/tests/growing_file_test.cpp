#include "app/growing_file.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::TemporaryFolder;

const GrowingFile::Format kFormat = {"time,x\n", "time,x\n"};

std::string Content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A file and what it says.
struct Output {
  explicit Output(const std::string& path, const GrowingFile::Format& format = kFormat)
      : file(
            path, format, signals, [this](const std::string& note) { notes.push_back(note); },
            [this](std::string_view line, std::uint64_t number) {
              lines.push_back(std::to_string(number) + ": " + std::string(line));
            }) {}

  void Write(const std::string& text) {
    file.Append(text);
    file.Flush();
  }

  Signals signals;
  std::vector<std::string> lines;
  std::vector<std::string> notes;
  GrowingFile file;
};

std::string ReasonOf(const std::string& path) {
  try {
    const Output output(path);
  } catch (const OutputError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

TEST(GrowingFile, BeginsWithItsHeaderAndGrowsWithEachFlush) {
  const TemporaryFolder folder;
  Output output(folder / "a.csv");
  EXPECT_EQ(Content(folder / "a.csv"), "time,x\n");
  output.file.Append("1,2\n");
  EXPECT_EQ(Content(folder / "a.csv"), "time,x\n");
  output.file.Append("2,3\n");
  output.file.Flush();
  EXPECT_EQ(Content(folder / "a.csv"), "time,x\n1,2\n2,3\n");
  output.file.Close();
}

TEST(GrowingFile, AppendsToWhatIsThereAndShowsIt) {
  const TemporaryFolder folder;
  const std::string path = folder.Write("a.csv", "time,x\n1,2\n2,3\n");
  Output output(path);
  EXPECT_EQ(output.lines, (std::vector<std::string>{"2: 1,2", "3: 2,3"}));
  output.Write("3,4\n");
  EXPECT_EQ(Content(path), "time,x\n1,2\n2,3\n3,4\n");
  EXPECT_TRUE(output.notes.empty());
}

TEST(GrowingFile, CutsOffALineThatWasNotFinished) {
  const std::string whole = "time,x\n1,2\n2,3\n";
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const TemporaryFolder folder;
    const std::string path = folder.Write("a.csv", whole.substr(0, size));
    Output output(path);
    output.Write("9,9\n");
    const std::string kept =
        size < 7 ? "time,x\n" : whole.substr(0, whole.rfind('\n', size - 1) + 1);
    EXPECT_EQ(Content(path), kept + "9,9\n") << size;
    const bool is_torn = size != 0 && whole[size - 1] != '\n';
    EXPECT_EQ(output.notes.size(), is_torn ? 1U : 0U) << size;
  }
}

TEST(GrowingFile, ReadsLongFilesInPieces) {
  std::string content = "time,x\n";
  for (int i = 0; i < 40'000; ++i) content += std::to_string(i) + ",1\n";
  const TemporaryFolder folder;
  const std::string path = folder.Write("a.csv", content + "77");
  const Output output(path);
  ASSERT_EQ(output.lines.size(), 40'000U);
  EXPECT_EQ(output.lines.back(), "40001: 39999,1");
  EXPECT_EQ(Content(path), content);
}

TEST(GrowingFile, NeverTouchesAFileThatIsNotItsOwn) {
  for (const std::string foreign :
       {"hello", "hello\n", "time,y\n1,2\n", "time,x,y\n1,2,3\n", "t", "time,x"}) {
    const TemporaryFolder folder;
    const std::string path = folder.Write("a.csv", foreign);
    if (foreign == "t" || foreign == "time,x") {  // the header of a run that was killed
      const Output output(path);
      EXPECT_EQ(Content(path), "time,x\n");
      continue;
    }
    EXPECT_EQ(ReasonOf(path), path +
                                  ": cannot be written: it holds something else, expected a new "
                                  "file or one that begins with 'time,x'");
    EXPECT_EQ(Content(path), foreign);
  }
}

TEST(GrowingFile, WithoutAHeaderKnowsItsOwnByTheirFirstText) {
  const GrowingFile::Format format = {"", "{\"event\":"};
  const TemporaryFolder folder;
  const std::string path = folder.Write("e.jsonl", "{\"event\":1}\n{\"ev");
  Output output(path, format);
  EXPECT_EQ(output.lines, std::vector<std::string>{"1: {\"event\":1}"});
  output.Write("{\"event\":2}\n");
  EXPECT_EQ(Content(path), "{\"event\":1}\n{\"event\":2}\n");
  EXPECT_THROW(Output(folder.Write("notes", "remember"), format), OutputError);
}

TEST(GrowingFile, BelongsToOneProcessAtATime) {
  const TemporaryFolder folder;
  const Output output(folder / "a.csv");
  EXPECT_NE(ReasonOf(folder / "a.csv").find("another process is writing it"), std::string::npos);
}

TEST(GrowingFile, GoesOnInANewFileAfterARotation) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.csv";
  Output output(path);
  output.Write("1,2\n");
  std::filesystem::rename(path, folder / "a.csv.1");
  output.Write("2,3\n");
  output.file.Reopen();
  output.Write("3,4\n");
  EXPECT_EQ(Content(folder / "a.csv.1"), "time,x\n1,2\n2,3\n");
  EXPECT_EQ(Content(path), "time,x\n3,4\n");
  output.file.Reopen();  // nothing was moved: the same file
  output.Write("4,5\n");
  EXPECT_EQ(Content(path), "time,x\n3,4\n4,5\n");
}

TEST(GrowingFile, AFileThatIsEmptiedInPlaceGetsItsHeaderAgain) {
  const TemporaryFolder folder;
  Output output(folder / "a.csv");
  output.Write("1,2\n");
  std::filesystem::resize_file(folder / "a.csv", 0);
  output.Write("2,3\n");
  EXPECT_EQ(Content(folder / "a.csv"), "time,x\n2,3\n");
}

TEST(GrowingFile, AnErrorLeavesNoTornLine) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.csv";
  Output output(path);
  output.Write("1,2\n");
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small = {14, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  EXPECT_THROW(output.Write("123456,123456\n"), OutputError);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_EQ(Content(path), "time,x\n1,2\n");
}

TEST(GrowingFile, AReaderThatLeavesIsAnError) {
  const TemporaryFolder folder;
  const std::string path = folder / "pipe";
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  const int reader = ::open(path.c_str(), O_RDONLY | O_NONBLOCK);
  Output output(path);
  char text[32] = {};
  EXPECT_EQ(::read(reader, text, sizeof(text)), 7);
  EXPECT_EQ(std::string(text), "time,x\n");
  ::close(reader);
  EXPECT_THROW(output.Write("1,2\n"), OutputError);
}

TEST(GrowingFile, AFullDeviceIsAnErrorAtTheStart) {
  EXPECT_NE(ReasonOf("/dev/full").find("/dev/full: cannot be written: No space left on device"),
            std::string::npos);
}

TEST(GrowingFile, AnUnwritablePlaceIsNamed) {
  const TemporaryFolder folder;
  EXPECT_NE(ReasonOf(folder / "absent/a.csv").find("No such file"), std::string::npos);
  EXPECT_NE(ReasonOf(folder.path()).find("irectory"), std::string::npos);
}

}  // namespace
}  // namespace unlidar
