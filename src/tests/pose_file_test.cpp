#include "io/pose_file.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using testing::TemporaryFolder;

std::vector<Pose> Read(const std::string& text) {
  const TemporaryFolder folder;
  folder.Write("poses.tum", text);
  return ReadPoses(folder / "poses.tum");
}

// Returns what is said of the text, without the folder.
std::string Problem(const std::string& text) {
  try {
    Read(text);
  } catch (const InputError& error) {
    const std::string message = error.what();
    return message.substr(message.rfind("poses.tum"));
  }
  return "";
}

const std::string kFirst = "1.0 0 0 0 0 0 0 1\n";

TEST(PoseFile, StampsAreExact) {
  const std::vector<Pose> poses = Read(
      "# stamp x y z qx qy qz qw\n\n"
      "1706255621.123456789 1 -2e1 .5 0 0 0 1\r\n"
      "  1706255622   1.5\t2 3  0.5 0.5 -0.5 0.502 \n");
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[0].time_ns, 1'706'255'621'123'456'789);
  EXPECT_EQ(poses[0].position_m, Eigen::Vector3d(1.0, -20.0, 0.5));
  EXPECT_EQ(poses[0].rotation_xyzw, Eigen::Vector4d(0, 0, 0, 1));
  EXPECT_EQ(poses[1].time_ns, 1'706'255'622'000'000'000);
  EXPECT_EQ(poses[1].rotation_xyzw, Eigen::Vector4d(0.5, 0.5, -0.5, 0.502));
}

TEST(PoseFile, WhatIsWrongIsSaidWithItsLine) {
  EXPECT_EQ(Problem(kFirst + "2.0 0 0 0 0 0 0\n"),
            "poses.tum:2: '2.0 0 0 0 0 0 0' has fewer values, expected `stamp x y z qx qy qz qw`");
  EXPECT_EQ(Problem(kFirst + "2.0 0 0 0 0 0 0 1 7\n"),
            "poses.tum:2: '7' is too much, expected `stamp x y z qx qy qz qw`");
  EXPECT_EQ(Problem(kFirst + "2.0 0 0 nan 0 0 0 1\n"),
            "poses.tum:2: 'nan' is no number, expected `stamp x y z qx qy qz qw`");
  EXPECT_EQ(Problem("stamp x y z qx qy qz qw\n"),
            "poses.tum:1: 'stamp' is no stamp, expected `stamp x y z qx qy qz qw`");
  EXPECT_EQ(Problem(kFirst + "#\n1.0 0 0 0 0 0 0 1\n"),
            "poses.tum:3: the stamp 1000000000 ns is not later than the one before, 1000000000 ns, "
            "expected rising stamps");
  EXPECT_EQ(Problem(kFirst + "2.0 0 4e5 0 0 0 0 1\n"),
            "poses.tum:2: the coordinate 4e+05 m, expected less than 100 km from the origin of a "
            "local frame");
  EXPECT_EQ(Problem(kFirst + "2.0 0 0 0 0 0 0 2\n"),
            "poses.tum:2: the quaternion has the norm 2, expected 1");
  EXPECT_EQ(Problem(kFirst + "9e9 0 0 0 0 0 0 1\n"),
            "poses.tum:2: the stamp 9000000000000000000 ns, expected a year from 1844 to 2096");
  EXPECT_EQ(Problem(kFirst), "poses.tum: 1 pose, expected at least two");
  EXPECT_EQ(Problem(""), "poses.tum: 0 poses, expected at least two");
}

}  // namespace
}  // namespace unlidar
