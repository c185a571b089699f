#include "io/followed_folders.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

using ::unlidar::testing::TemporaryFolder;

// Follows folders and collects the names of their frames.
class Follower {
 public:
  explicit Follower(const std::vector<std::string>& directories,
                    std::optional<TimeNs> after_ns = std::nullopt, const Config& config = {})
      : folders(SourcesOf(directories), config, after_ns,
                [this](const InputError& error) { bad.emplace_back(error.what()); }) {}

  static std::vector<FrameSource> SourcesOf(const std::vector<std::string>& directories) {
    std::vector<FrameSource> sources;
    for (const std::string& directory : directories) sources.push_back({"", directory});
    return sources;
  }

  // The names of all frames that are complete now; of several folders "FOLDER/NAME".
  std::vector<std::string> Take() {
    folders.Update();
    std::vector<std::string> names;
    while (const auto frame = folders.Next()) {
      const fs::path path = frame->file.path;
      names.push_back((path.parent_path().filename() / path.filename()).string());
      arrived.push_back(frame->arrived.has_value());
    }
    return names;
  }

  std::vector<std::string> bad;
  std::vector<bool> arrived;  // of each frame: it arrived while the folder was followed
  FollowedFolders folders;
};

using Names = std::vector<std::string>;

void Rename(const TemporaryFolder& folder, const std::string& name, const std::string& bytes = "") {
  const std::string temporary = folder.Write("unfinished", bytes);
  fs::create_directories(fs::path(folder / name).parent_path());
  fs::rename(temporary, folder / name);
}

TEST(FollowedFolders, GivesWhatIsThereInOrderOfStampsThenWhatAppears) {
  const TemporaryFolder folder;
  for (const char* name : {"f/10.0.pcd", "f/9.5.pcd", "f/11.0.pcd", "f/.8.pcd", "f/notes.txt"}) {
    folder.Write(name, "");
  }
  fs::create_directories(folder / "f/7.0.pcd");
  Follower follower({folder / "f"});
  EXPECT_EQ(follower.Take(), (Names{"f/9.5.pcd", "f/10.0.pcd", "f/11.0.pcd"}));
  EXPECT_EQ(follower.arrived, (std::vector<bool>{false, false, false}));
  Rename(folder, "f/12.0.pcd");
  folder.Write("f/11.5.pcd", "");  // closed after it was written
  EXPECT_EQ(follower.Take(), (Names{"f/11.5.pcd", "f/12.0.pcd"}));
  EXPECT_TRUE(follower.arrived.back());
  EXPECT_TRUE(follower.Take().empty());
  EXPECT_TRUE(follower.bad.empty());
}

// One name of another time must not take its arrival from all that comes later.
TEST(FollowedFolders, OnlyWhatWasThereHasNoTimeOfArrival) {
  const TemporaryFolder folder;
  folder.Write("f/3960000000.0.pcd", "");
  folder.Write("f/1.0.pcd", "");
  Follower follower({folder / "f"});
  EXPECT_EQ(follower.Take().size(), 2U);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // the grain of times of files
  folder.Write("f/2.0.pcd", "");
  EXPECT_EQ(follower.Take(), Names{"f/2.0.pcd"});
  fs::rename(folder / "f", folder / "g");
  folder.Write("g/4.0.pcd", "");
  fs::rename(folder / "g", folder / "f");
  EXPECT_EQ(follower.Take(), Names{"f/4.0.pcd"});  // found by listing
  EXPECT_EQ(follower.arrived, (std::vector<bool>{false, false, true, true}));
}

TEST(FollowedFolders, TellsByItsDescriptorThatSomethingHappened) {
  const TemporaryFolder folder;
  Follower follower({folder.path()});
  pollfd ready = {follower.folders.fd(), POLLIN, 0};
  EXPECT_EQ(::poll(&ready, 1, 0), 0);
  folder.Write("1.0.pcd", "");
  EXPECT_EQ(::poll(&ready, 1, 0), 1);
  EXPECT_EQ(follower.Take().size(), 1U);
  EXPECT_EQ(::poll(&ready, 1, 0), 0);
}

TEST(FollowedFolders, MergesFoldersByStampAndOffset) {
  const TemporaryFolder folder;
  for (const char* name : {"a/1.0.pcd", "a/2.0.pcd", "b/1.5.pcd", "b/1.0.pcd"}) {
    folder.Write(name, "");
  }
  Follower same({folder / "a", folder / "b"});
  EXPECT_EQ(same.Take(), (Names{"a/1.0.pcd", "b/1.0.pcd", "b/1.5.pcd", "a/2.0.pcd"}));
  Config config;
  config.sensors["b"].time_offset_s = 10.0;
  Follower late({folder / "a", folder / "b"}, std::nullopt, config);
  EXPECT_EQ(late.Take(), (Names{"a/1.0.pcd", "a/2.0.pcd", "b/1.0.pcd", "b/1.5.pcd"}));
}

TEST(FollowedFolders, NeverGivesAFileThatIsBeingWritten) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "f");
  std::ofstream before(folder / "f/1.0.pcd");
  before << "half" << std::flush;
  Follower follower({folder / "f"});
  EXPECT_TRUE(follower.Take().empty());
  std::ofstream during(folder / "f/2.0.pcd");
  during << "half" << std::flush;
  folder.Write("f/3.0.pcd", "");
  EXPECT_EQ(follower.Take(), Names{"f/3.0.pcd"});
  during.close();
  EXPECT_EQ(follower.Take(), Names{"f/2.0.pcd"});
  before.close();
  EXPECT_EQ(follower.Take(), Names{"f/1.0.pcd"});
}

TEST(FollowedFolders, WaitsForAFileOfAnotherUserToSettleUnlessItSawItsWriterCloseIt) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can be two users";
  const TemporaryFolder folder;
  fs::permissions(folder.path(), fs::perms::all);
  folder.Write("1.0.pcd", "");
  fs::last_write_time(folder / "1.0.pcd", fs::file_time_type::clock::now() - std::chrono::hours(1));
  folder.Write("2.0.pcd", "");  // its writer may still be at it
  constexpr uid_t kNobody = 65534;
  ASSERT_EQ(::seteuid(kNobody), 0);
  Follower follower({folder.path()});
  EXPECT_EQ(follower.Take().size(), 1U);
  ASSERT_EQ(::seteuid(0), 0);
  folder.Write("3.0.pcd", "");
  ASSERT_EQ(::seteuid(kNobody), 0);
  EXPECT_EQ(follower.Take().size(), 1U);
  std::size_t later = 0;
  for (int i = 0; i < 50 && later == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    later = follower.Take().size();
  }
  EXPECT_EQ(later, 1U);
  ASSERT_EQ(::seteuid(0), 0);
}

TEST(FollowedFolders, WaitsForAFolderThatIsNotThereYet) {
  const TemporaryFolder folder;
  Follower follower({folder / "a/b/f", folder / "a/g"});
  EXPECT_TRUE(follower.Take().empty());
  fs::create_directories(folder / "a");
  EXPECT_TRUE(follower.Take().empty());
  fs::create_directories(folder / "a/b/f");
  folder.Write("a/b/f/1.0.pcd", "");  // before anybody looks
  EXPECT_EQ(follower.Take(), Names{"f/1.0.pcd"});
  folder.Write("a/b/f/2.0.pcd", "");
  Rename(folder, "a/h/3.0.pcd");
  fs::rename(folder / "a/h", folder / "a/g");
  EXPECT_EQ(follower.Take(), (Names{"f/2.0.pcd", "g/3.0.pcd"}));
  folder.Write("a/g/4.0.pcd", "");
  EXPECT_EQ(follower.Take(), Names{"g/4.0.pcd"});
}

TEST(FollowedFolders, MissesNoFolderThatAppearsWhileItLooks) {
  const TemporaryFolder folder;
  Follower follower({folder / "a/b/c/d/e/g/h/i/j/k/l/f"});
  for (int round = 0; round < 30; ++round) {
    const std::string name = std::to_string(round) + ".0.pcd";
    std::thread recorder([&] { folder.Write("a/b/c/d/e/g/h/i/j/k/l/f/" + name, ""); });
    Names names;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
    while (names.empty() && std::chrono::steady_clock::now() < end) names = follower.Take();
    recorder.join();
    ASSERT_EQ(names, Names{"f/" + name});
    fs::remove_all(folder / "a");
    follower.Take();
  }
}

TEST(FollowedFolders, OneFolderMayLieInAnother) {
  const TemporaryFolder folder;
  Follower follower({folder / "f", folder / "f/inner"});
  fs::create_directories(folder / "f");
  folder.Write("f/1.0.pcd", "");
  EXPECT_EQ(follower.Take(), Names{"f/1.0.pcd"});
  folder.Write("f/inner/2.0.pcd", "");
  folder.Write("f/3.0.pcd", "");
  EXPECT_EQ(follower.Take(), (Names{"inner/2.0.pcd", "f/3.0.pcd"}));
  folder.Write("f/4.0.pcd", "");
  EXPECT_EQ(follower.Take(), Names{"f/4.0.pcd"});
}

TEST(FollowedFolders, AFolderThatIsRemovedMayComeBack) {
  const TemporaryFolder folder;
  folder.Write("f/1.0.pcd", "");
  Follower follower({folder / "f"});
  EXPECT_EQ(follower.Take(), Names{"f/1.0.pcd"});
  for (int i = 0; i < 3; ++i) {
    fs::remove_all(folder / "f");
    EXPECT_TRUE(follower.Take().empty());
    folder.Write("f/1.0.pcd", "");  // given already
    folder.Write("f/" + std::to_string(2 * i + 2) + ".0.pcd", "");
    EXPECT_EQ(follower.Take(), Names{"f/" + std::to_string(2 * i + 2) + ".0.pcd"});
    folder.Write("f/" + std::to_string(2 * i + 3) + ".0.pcd", "");
    EXPECT_EQ(follower.Take(), Names{"f/" + std::to_string(2 * i + 3) + ".0.pcd"});
  }
}

TEST(FollowedFolders, AFolderThatIsMovedAwayIsNotFollowedThere) {
  const TemporaryFolder folder;
  folder.Write("f/1.0.pcd", "");
  Follower follower({folder / "f"});
  EXPECT_EQ(follower.Take().size(), 1U);
  fs::rename(folder / "f", folder / "old");
  EXPECT_TRUE(follower.Take().empty());
  folder.Write("old/2.0.pcd", "");
  folder.Write("f/3.0.pcd", "");
  EXPECT_EQ(follower.Take(), Names{"f/3.0.pcd"});
}

TEST(FollowedFolders, CountsFilesThatAreGoneBeforeTheyAreRead) {
  const TemporaryFolder folder;
  Follower follower({folder.path()});
  for (const char* name : {"1.0.pcd", "2.0.pcd", "3.0.pcd"}) folder.Write(name, "");
  fs::remove(folder / "1.0.pcd");
  fs::remove(folder / "3.0.pcd");
  EXPECT_EQ(follower.Take().size(), 1U);
  EXPECT_EQ(follower.folders.counts().vanished, 2U);
}

TEST(FollowedFolders, GivesAFrameOnce) {
  const TemporaryFolder folder;
  folder.Write("1.0.pcd", "");
  Follower follower({folder.path()});
  folder.Write("1.0.pcd", "again, before it was read");
  EXPECT_EQ(follower.Take().size(), 1U);
  EXPECT_EQ(follower.folders.counts().passed_over, 0U);
  folder.Write("1.0.pcd", "again, after it was read");
  folder.Write("1.00.pcd", "the same stamp");
  EXPECT_TRUE(follower.Take().empty());
  EXPECT_EQ(follower.folders.counts().passed_over, 2U);
}

TEST(FollowedFolders, PassesOverWhatAnEarlierRunHasWorkedOff) {
  const TemporaryFolder folder;
  for (const char* name : {"f/1.0.pcd", "f/2.0.pcd", "f/3.0.pcd"}) folder.Write(name, "");
  Follower follower({folder / "f"}, 2'000'000'000);
  EXPECT_EQ(follower.folders.counts().already_processed, 2U);
  EXPECT_EQ(follower.Take(), Names{"f/3.0.pcd"});
  folder.Write("f/1.5.pcd", "");  // it is new, whatever its clock says
  EXPECT_EQ(follower.Take(), Names{"f/1.5.pcd"});
  fs::rename(folder / "f", folder / "g");
  fs::rename(folder / "g", folder / "f");
  EXPECT_TRUE(follower.Take().empty());  // listed again
  EXPECT_EQ(follower.folders.counts().already_processed, 2U);
  EXPECT_EQ(follower.folders.counts().passed_over, 0U);
}

TEST(FollowedFolders, GivesFramesOfAClockThatHasGoneBackHoweverManyItGaveBefore) {
  const TemporaryFolder folder;
  Follower follower({folder / "f"});
  const int count = static_cast<int>(FollowedFolders::kMaxDelivered) + 100;
  for (int i = 0; i < count; ++i) folder.Write("f/" + std::to_string(10'000 + i) + ".0.pcd", "");
  EXPECT_EQ(follower.Take().size(), static_cast<std::size_t>(count));
  for (const char* name : {"f/5000.0.pcd", "f/5001.0.pcd"}) folder.Write(name, "");
  EXPECT_EQ(follower.Take(), (Names{"f/5000.0.pcd", "f/5001.0.pcd"}));
  folder.Write("f/5000.0.pcd", "again");
  EXPECT_TRUE(follower.Take().empty());
  EXPECT_EQ(follower.folders.counts().passed_over, 1U);
  // Nor is any given twice where the folder has to be listed again.
  fs::rename(folder / "f", folder / "g");
  fs::rename(folder / "g", folder / "f");
  EXPECT_TRUE(follower.Take().empty());
}

TEST(FollowedFolders, ListsAgainWhatTheSystemLostCountOf) {
  std::ifstream limit("/proc/sys/fs/inotify/max_queued_events");
  int events = 0;
  limit >> events;
  if (events == 0 || events > 100'000) GTEST_SKIP() << "a queue of " << events << " events";
  const TemporaryFolder folder;
  Follower follower({folder.path()});
  folder.Write("1.0.pcd", "");
  for (int i = 0; i < events; ++i) folder.Write(i % 2 == 0 ? "a" : "b", "");
  for (int i = 2; i < 100; ++i) folder.Write(std::to_string(i) + ".0.pcd", "");
  EXPECT_EQ(follower.Take().size(), 99U);
  folder.Write("100.0.pcd", "");
  EXPECT_EQ(follower.Take().size(), 1U);
}

TEST(FollowedFolders, RemembersNoMoreThanItsBoundAndLosesNone) {
  const TemporaryFolder folder;
  const int count = static_cast<int>(FollowedFolders::kMaxPending) + 500;
  for (int i = 0; i < count; ++i) {
    const int fd =
        ::open((folder / (std::to_string(i) + ".0.pcd")).c_str(), O_CREAT | O_WRONLY, 0600);
    ::close(fd);
  }
  Follower follower({folder.path()});
  EXPECT_EQ(follower.folders.num_pending(), FollowedFolders::kMaxPending);
  for (int i = 0; i <= count; ++i) {
    const auto frame = follower.folders.Next();
    ASSERT_TRUE(frame.has_value());
    ASSERT_EQ(fs::path(frame->file.path).stem(), std::to_string(i) + ".0");
    if (i == 10) {  // there is room for it, but not yet for those before it
      folder.Write(std::to_string(count) + ".0.pcd", "");
      follower.folders.Update();
    }
  }
  EXPECT_FALSE(follower.folders.Next().has_value());
}

TEST(FollowedFolders, NumberedFramesHaveTheTimesThatTheyHaveInARecording) {
  const TemporaryFolder folder;
  for (const char* name : {"f/000000.pcd", "f/000100.pcd", "f/000200.pcd"}) folder.Write(name, "");
  Follower follower({folder / "f"});
  folder.Write("f/000300.pcd", "");
  follower.folders.Update();
  std::vector<TimeNs> stamps_ns;
  while (const auto frame = follower.folders.Next()) stamps_ns.push_back(frame->file.stamp_ns);
  EXPECT_EQ(stamps_ns, (std::vector<TimeNs>{0, 100'000'000, 200'000'000, 300'000'000}));
  ASSERT_EQ(follower.folders.TakeWarnings().size(), 1U);
  EXPECT_TRUE(follower.folders.TakeWarnings().empty());
  folder.Write("f/0.5.pcd", "");  // a stamp among numbers
  EXPECT_TRUE(follower.Take().empty());
  EXPECT_EQ(follower.bad.size(), 1U);
}

TEST(FollowedFolders, ANameThatIsNoStampIsBad) {
  const TemporaryFolder folder;
  folder.Write("map.pcd", "");
  Follower follower({folder.path()});
  folder.Write("roof.pcd", "");
  EXPECT_TRUE(follower.Take().empty());
  ASSERT_EQ(follower.bad.size(), 2U);
  EXPECT_NE(follower.bad[0].find("map.pcd: 'map' is no stamp, expected"), std::string::npos);
  EXPECT_NE(follower.bad[1].find("roof.pcd: 'roof' is no stamp, expected"), std::string::npos);
}

TEST(FollowedFolders, RefuseStampsInAFile) {
  const TemporaryFolder folder;
  folder.Write("f/timestamps.csv", "file,timestamp\n");
  EXPECT_THROW(Follower({folder / "f"}), InputError);
  Follower follower({folder / "g"});
  folder.Write("g/timestamps.csv", "file,timestamp\n");
  EXPECT_THROW(follower.Take(), InputError);
}

TEST(FollowedFolders, RefuseWhatIsNoFolder) {
  const TemporaryFolder folder;
  const std::string file = folder.Write("file", "");
  for (const std::string& path : {file, file + "/below"}) {
    try {
      const Follower follower({path});
      ADD_FAILURE() << "no error";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("expected a folder"), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace unlidar
