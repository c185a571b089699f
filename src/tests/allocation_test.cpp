// What happens where memory runs out: in the whole program, at each of its allocations.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <fstream>
#include <new>
#include <string>
#include <vector>

#include "base/memory_reserve.hpp"
#include "io/pcd.hpp"
#include "tests/synthetic_recording.hpp"
#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

using testing::TemporaryFolder;

// A drone that passes, seen alone in ten frames.
void WriteFlight(const TemporaryFolder& folder) {
  testing::Random random(1);
  for (int i = 0; i < 10; ++i) {
    std::vector<Eigen::Vector3f> points_m;
    const Eigen::Vector3d centre_m(-4.0 + 0.3 * i, 5.0, 12.0);
    for (int k = 0; k < 4; ++k) {
      points_m.push_back((centre_m + random.NormalVector(0.05)).cast<float>());
    }
    folder.Write("frames/" + std::to_string(1000.0 + 0.1 * i) + ".pcd", BinaryPcd(points_m));
  }
}

class Allocations : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef UNLIDAR_SANITIZED
    GTEST_SKIP() << "the sanitizer has allocations of its own";
#endif
  }
};
class MemoryReserveTest : public Allocations {};

// It ends in order: nothing but "out of memory", or all as if nothing had failed.
TEST_F(Allocations, AnyThatFailsEndsTheProgramInOrder) {
  const TemporaryFolder folder;
  WriteFlight(folder);
  const std::string command =
      "ALLOCATIONS_REPORT=" + (folder / "report") + " ALLOCATIONS_OUTPUT=" + (folder / "traj.csv") +
      " ALLOCATIONS_STDERR=" + (folder / "stderr") +
      " LD_PRELOAD=" UNLIDAR_ALLOCATION_SHIM " '" UNLIDAR_TRACK "' --quiet --frames " +
      (folder / "frames") + " --out " + (folder / "traj.csv") + " --points " +
      (folder / "points.pcd") +
      // The same work, done less often.
      " --set 'robust.disabled_rules=[second_round]' --set 'robust.tracker.sigma_a_mps2=[3]'";
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
  std::ifstream report(folder / "report");
  int code = 0;
  std::string text;
  int num_failed = 0;
  int num_unharmed = 0;
  for (int n = 1; report >> code && std::getline(report, text); ++n) {
    EXPECT_TRUE(code == 0 || code == 1) << "allocation " << n << ": " << code << text;
    EXPECT_EQ(text, code == 0 ? " " : " unlidar_track: error: out of memory") << n;
    (code == 0 ? num_unharmed : num_failed) += 1;
  }
  EXPECT_GT(num_failed, 1000);
  EXPECT_GT(num_failed, 20 * num_unharmed);
  std::ifstream trajectory(folder / "traj.csv");
  std::getline(trajectory, text);
  EXPECT_TRUE(trajectory && std::getline(trajectory, text)) << "there is a flight to be found";
}

constexpr std::size_t kTooMuch = std::size_t{1} << 60U;

TEST_F(MemoryReserveTest, LetsThrowWhatDoesNotFitItEither) {
  const MemoryReserve reserve(1000);
  EXPECT_FALSE(reserve.was_needed());
  EXPECT_THROW(::operator delete(::operator new(kTooMuch)), std::bad_alloc);
  EXPECT_TRUE(reserve.was_needed());
}

TEST_F(MemoryReserveTest, LeavesTheHandlerAsItWas) {
  const std::new_handler before = std::get_new_handler();
  { const MemoryReserve reserve(1000); }
  EXPECT_EQ(std::get_new_handler(), before);
  EXPECT_THROW(MemoryReserve reserve(kTooMuch), std::bad_alloc);
  EXPECT_EQ(std::get_new_handler(), before);
}

}  // namespace
}  // namespace unlidar
