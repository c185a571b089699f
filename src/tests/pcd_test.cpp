#include "io/pcd.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <random>

#include "io/pcd_format.hpp"
#include "tests/pcd_oracle.hpp"
#include "tests/pcd_writer.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using testing::Encoded;
using testing::FieldSpec;
using testing::TemporaryFolder;
using testing::TestCloud;
using testing::TestEncoding;

constexpr TestEncoding kEncodings[] = {TestEncoding::kAscii, TestEncoding::kBinary,
                                       TestEncoding::kCompressed,
                                       TestEncoding::kCompressedWithPadding};

TEST(PcdFiles, EveryReadableFileGivesThePointsOfPcl) {
  const auto paths = testing::SharedPcdFiles("readable");
  if (paths.empty()) GTEST_SKIP() << "no ../shared/data/formats/pcd/readable";
  // Here PCL is wrong: it leaves float64 coordinates and fields X Y Z at zero without an error.
  // Its own blob holds the right values.
  const std::vector<std::string> pcl_wrong = {"pdal_autzen_f64_uppercase.pcd",
                                              "pcdrs_mixed_types_compressed.pcd"};
  for (const auto& path : paths) {
    SCOPED_TRACE(path.filename());
    const PcdCloud cloud = ReadPcd(path.string());
    const auto blob = testing::PclBlob(path.string());
    ASSERT_TRUE(blob);
    EXPECT_EQ(cloud.points_m.size(), std::size_t{blob->width} * blob->height);
    EXPECT_TRUE(testing::SamePoints(cloud.points_m, testing::PclPointsOfAnyType(*blob)));
    const bool is_wrong = std::count(pcl_wrong.begin(), pcl_wrong.end(), path.filename()) > 0;
    EXPECT_NE(testing::SamePoints(cloud.points_m, testing::PclPoints(*blob)), is_wrong);
  }
}

TEST(PcdFiles, EveryMalformedFileIsRefusedInOneLineThatNamesIt) {
  const auto paths = testing::SharedPcdFiles("malformed");
  if (paths.empty()) GTEST_SKIP() << "no ../shared/data/formats/pcd/malformed";
  for (const auto& path : paths) {
    SCOPED_TRACE(path.filename());
    try {
      ReadPcd(path.string());
      ADD_FAILURE() << "was read";
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_EQ(message.rfind(path.string() + ": ", 0), 0U) << message;
      EXPECT_NE(message.find("expected"), std::string::npos) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
  }
}

TEST(PcdFiles, AMissingFileAndADirectoryAreRefused) {
  const TemporaryFolder folder;
  EXPECT_THROW(ReadPcd(folder / "none.pcd"), InputError);
  EXPECT_THROW(ReadPcd(folder.path()), InputError);
}

// The file with zeros behind it, none of which takes room on the disk.
std::string WriteSparse(const TemporaryFolder& folder, const std::string& bytes,
                        std::uintmax_t size) {
  std::string path = folder.Write("sparse.pcd", bytes);
  std::filesystem::resize_file(path, size);
  return path;
}

constexpr std::uintmax_t kHundredGigabytes = std::uintmax_t{100} << 30;

TEST(PcdFiles, OfAnEndlessFileNoMoreIsReadThanItsPointsTake) {
  TestCloud cloud{{{"x"}, {"y"}, {"z"}, {"t", 'U', 4}}, {}};
  for (int i = 0; i < 200'000; ++i) cloud.values.push_back({1.0 * i, 0.5 * i, -2.0 * i, 1.0 * i});
  const TemporaryFolder folder;
  for (const TestEncoding encoding : {TestEncoding::kBinary, TestEncoding::kCompressed}) {
    const std::string bytes = Encoded(cloud, encoding);
    EXPECT_GT(bytes.size(), std::size_t{1} << 20);  // more than the first read
    const PcdCloud expected = ParsePcd(bytes, "memory");
    for (const std::uintmax_t size : {std::uintmax_t{bytes.size()}, kHundredGigabytes}) {
      const PcdCloud read = ReadPcd(WriteSparse(folder, bytes, size));
      EXPECT_EQ(read.points_m, expected.points_m);
      EXPECT_EQ(read.integer_times, expected.integer_times);
    }
  }
}

TEST(PcdFiles, WhatNoLidarHasInAFrameIsRefusedByNameAndSize) {
  const auto header = [](const std::string& points, const std::string& data) {
    return "FIELDS x y z w\nSIZE 8 8 8 8\nTYPE F F F F\nPOINTS " + points + "\nDATA " + data + "\n";
  };
  std::string nothing;
  nothing.resize(50'000'000);
  const std::pair<std::string, std::string> expected_by_start[] = {
      {"", "begins with '????"},
      {header("2", "ascii") + "1 2 3 4\n5 6 7 8\n", "takes 107374182400 bytes, expected at most"},
      {header("60000000", "binary"), "takes 19200000"},
      {header("67108865", "binary"), "at most 67108864"},
      {header("60000000", "binary_compressed") + testing::WithSizes(nothing, 1'920'000'000),
       "unpacks to 1920000000 bytes, expected at most 1073741824"}};
  const TemporaryFolder folder;
  for (const auto& [start, expected] : expected_by_start) {
    const std::string path = WriteSparse(folder, start, kHundredGigabytes);
    try {
      ReadPcd(path);
      ADD_FAILURE() << expected;
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_EQ(message.rfind(path + ": ", 0), 0U) << message;
      EXPECT_NE(message.find(expected), std::string::npos) << message << " | " << expected;
    }
  }
}

// Of any length up to 1 MiB, from a file as from memory.
TEST(PcdFiles, AHeaderMayBeLongButNotEndless) {
  const std::string frame = BinaryPcd({{1, 2, 3}, {4, 5, 6}});
  const std::size_t header_bytes = frame.size() - 24;
  const TemporaryFolder folder;
  for (const int excess : {-1000, -13, -1, 0, 1, 5}) {
    const std::size_t comment_bytes =
        static_cast<std::size_t>((1 << 20) - static_cast<int>(header_bytes) + excess);
    const std::string bytes = "#" + std::string(comment_bytes - 2, 'c') + "\n" + frame;
    if (excess < 0) {
      EXPECT_EQ(ReadPcd(folder.Write("long.pcd", bytes)).points_m.size(), 2U) << excess;
      EXPECT_EQ(ParsePcd(bytes, "memory").points_m.size(), 2U) << excess;
    } else {
      EXPECT_THROW(ReadPcd(folder.Write("long.pcd", bytes)), InputError) << excess;
      EXPECT_THROW(ParsePcd(bytes, "memory"), InputError) << excess;
    }
  }
}

// Fields in any order, of any type and count, padding between them, in all encodings: the values
// are known, and PCL agrees where it reads the file at all.
TEST(PcdLayouts, RandomLayoutsGiveTheValuesThatWereWritten) {
  const TemporaryFolder folder;
  std::mt19937 generator(7);
  const auto pick = [&](int n) { return static_cast<int>(generator() % static_cast<unsigned>(n)); };
  const std::pair<char, int> types[] = {{'F', 4}, {'F', 8}, {'I', 1}, {'I', 2}, {'I', 4},
                                        {'I', 8}, {'U', 1}, {'U', 2}, {'U', 4}, {'U', 8}};
  for (int trial = 0; trial < 200; ++trial) {
    TestCloud cloud;
    for (const char* name : {"x", "y", "z", "time"}) {
      const auto [type, size] = types[pick(10)];
      cloud.fields.push_back(
          {pick(8) == 0 && *name != 't' ? std::string(1, *name) : name, type, size, 1});
    }
    for (int extra = pick(4); extra > 0; --extra) {
      const auto [type, size] = types[pick(10)];
      cloud.fields.push_back(
          {pick(2) == 0 ? "_" : "extra" + std::to_string(extra), type, size, 1 + pick(3)});
    }
    std::shuffle(cloud.fields.begin(), cloud.fields.end(), generator);
    const int num_rows = pick(20);
    for (int row = 0; row < num_rows; ++row) {
      cloud.values.emplace_back();
      for (const FieldSpec& field : cloud.fields) {
        for (int i = 0; i < field.count; ++i) {
          double value = pick(256) - (field.type == 'U' ? 0 : 128);
          if (field.type == 'F') value = static_cast<float>(value + pick(1000) / 1000.0);
          cloud.values.back().push_back(value);
        }
      }
    }
    const auto true_column = [&](const std::string& name) {
      std::size_t offset = 0;
      for (const FieldSpec& field : cloud.fields) {
        if (field.name == name) break;
        offset += static_cast<std::size_t>(field.count);
      }
      std::vector<double> column;
      for (const auto& row : cloud.values) column.push_back(row[offset]);
      return column;
    };
    for (const TestEncoding encoding : kEncodings) {
      const std::string bytes = Encoded(cloud, encoding);
      SCOPED_TRACE(bytes.substr(0, bytes.find("\nDATA") + 25));
      const PcdCloud read = ParsePcd(bytes, "frame.pcd");
      ASSERT_EQ(read.points_m.size(), cloud.values.size());
      const std::vector<double> x = true_column("x");
      const std::vector<double> y = true_column("y");
      const std::vector<double> z = true_column("z");
      const std::vector<double> time = true_column("time");
      const bool is_integer = read.floating_times.empty();
      ASSERT_EQ(read.integer_times.size() + read.floating_times.size(), time.size());
      for (std::size_t i = 0; i < x.size(); ++i) {
        EXPECT_EQ(read.points_m[i].cast<double>(), Eigen::Vector3d(x[i], y[i], z[i]));
        EXPECT_EQ(is_integer ? static_cast<double>(read.integer_times[i]) : read.floating_times[i],
                  time[i]);
      }

      const bool has_padding = std::any_of(cloud.fields.begin(), cloud.fields.end(),
                                           [](const FieldSpec& f) { return f.name == "_"; });
      // PCL copies compressed rows with a stride that forgets the padding.
      const bool compressed = encoding != TestEncoding::kAscii && encoding != TestEncoding::kBinary;
      if ((compressed && has_padding) || cloud.values.empty()) continue;
      const auto blob = testing::PclBlob(folder.Write("layout.pcd", bytes));
      ASSERT_TRUE(blob);
      EXPECT_TRUE(testing::SamePoints(read.points_m, testing::PclPointsOfAnyType(*blob)));
    }
  }
}

TEST(PcdLayouts, UpperCaseCoordinatesAreReadAndLowerCaseOnesComeFirst) {
  TestCloud cloud{{{"X", 'F', 8}, {"Y", 'F', 4}, {"Z", 'I', 2}}, {{1.5, 2.5, -3.0}}};
  EXPECT_EQ(ParsePcd(Encoded(cloud, TestEncoding::kBinary), "f").points_m[0],
            Eigen::Vector3f(1.5F, 2.5F, -3.0F));
  cloud = {{{"X"}, {"x"}, {"Y"}, {"z"}}, {{1.0, 2.0, 3.0, 4.0}}};
  EXPECT_EQ(ParsePcd(Encoded(cloud, TestEncoding::kBinary), "f").points_m[0],
            Eigen::Vector3f(2.0F, 3.0F, 4.0F));
}

TEST(PcdLayouts, FieldsOfCountZeroTakeNoRoom) {
  const std::string header =
      "FIELDS x none y z\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 0 1 1\nWIDTH 1\nPOINTS 1\n";
  EXPECT_EQ(ParsePcd(header + "DATA ascii\n1 2 3\n", "f").points_m[0], Eigen::Vector3f(1, 2, 3));
}

TEST(PcdTimes, TheFieldIsTheFirstOfTheKnownNamesInAnyCase) {
  const auto time_of = [](const std::vector<std::string>& names) {
    TestCloud cloud{{{"x"}, {"y"}, {"z"}}, {{0.0, 0.0, 0.0}}};
    for (const std::string& name : names) {
      cloud.fields.push_back({name, 'F', 8});
      cloud.values[0].push_back(static_cast<double>(cloud.values[0].size()));
    }
    const PcdCloud read = ParsePcd(Encoded(cloud, TestEncoding::kBinary), "f");
    return read.floating_times.empty() ? 0.0 : read.floating_times[0];
  };
  EXPECT_EQ(time_of({}), 0.0);
  EXPECT_EQ(time_of({"intensity", "ring", "time_stamp"}), 0.0);
  for (const char* name : {"t", "T", "time", "Time", "timestamp", "TimeStamp", "offset_time"}) {
    EXPECT_EQ(time_of({"ring", name}), 4.0) << name;
  }
  EXPECT_EQ(time_of({"offset_time", "timestamp", "time", "t"}), 6.0);
  EXPECT_EQ(time_of({"offset_time", "timestamp"}), 4.0);
}

TEST(PcdTimes, WholeNumbersKeepAllTheirDigits) {
  const std::string header = "FIELDS x y t\nSIZE 4 4 8\nTYPE F F U\nWIDTH 2\nPOINTS 2\nDATA ";
  const PcdCloud text = ParsePcd(header + "ascii\n0 0 1706255621614239001\n0 0 12.0\n", "f");
  EXPECT_EQ(text.integer_times, (std::vector<std::int64_t>{1'706'255'621'614'239'001, 12}));
  const std::uint64_t values[] = {1'706'255'621'614'239'001U,
                                  std::numeric_limits<std::uint64_t>::max()};
  std::string bytes;
  for (const std::uint64_t& value : values) {
    bytes += std::string(8, '\0') + std::string(reinterpret_cast<const char*>(&value), 8);
  }
  EXPECT_EQ(ParsePcd(header + "binary\n" + bytes, "f").integer_times,
            (std::vector<std::int64_t>{1'706'255'621'614'239'001,
                                       std::numeric_limits<std::int64_t>::max()}));
  EXPECT_THROW(ParsePcd(header + "ascii\n0 0 1e30\n0 0 0\n", "f"), InputError);
}

TEST(BinaryPcd, IsReadBackByPclAndByUs) {
  const TemporaryFolder folder;
  std::mt19937 generator(3);
  std::normal_distribution<float> coordinate_m(0.0F, 30.0F);
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, std::size_t{1000}}) {
    std::vector<Eigen::Vector3f> points_m(size);
    for (auto& p : points_m) {
      p = {coordinate_m(generator), coordinate_m(generator), coordinate_m(generator)};
    }
    const std::string path = folder.Write("points.pcd", BinaryPcd(points_m));
    EXPECT_EQ(ReadPcd(path).points_m, points_m);
    const auto blob = testing::PclBlob(path);
    if (size == 0) continue;  // PCL cannot map a file without data
    ASSERT_TRUE(blob);
    EXPECT_EQ(testing::PclPoints(*blob), points_m);
  }
}

TEST(Lzf, UnpacksWhatPclPacks) {
  std::mt19937 generator(5);
  for (int trial = 0; trial < 300; ++trial) {
    const std::size_t size = 1 + generator() % 20'000;
    const auto letters = 1 + generator() % 200;
    std::string bytes(size, '\0');
    for (std::size_t i = 0; i < size; ++i) {
      const bool repeat = i > 10 && generator() % 8 != 0;
      bytes[i] =
          repeat ? bytes[i - 1 - generator() % 10] : static_cast<char>(generator() % letters);
    }
    const std::string packed = testing::Compressed(bytes);
    ASSERT_FALSE(packed.empty());
    EXPECT_LE(size, kLzfMaxExpansion * packed.size());
    std::string unpacked(size, '\0');
    const auto unpack = [&](std::size_t packed_size, std::size_t unpacked_size) {
      return LzfDecompress(reinterpret_cast<const std::uint8_t*>(packed.data()), packed_size,
                           reinterpret_cast<std::uint8_t*>(unpacked.data()), unpacked_size);
    };
    ASSERT_TRUE(unpack(packed.size(), size));
    EXPECT_EQ(unpacked, bytes);
    EXPECT_FALSE(unpack(packed.size() - 1, size));
    EXPECT_FALSE(unpack(packed.size(), size - 1));
  }
}

TEST(Lzf, RefusesAReferenceToBytesBeforeTheFirst) {
  std::uint8_t out[4] = {};
  const std::uint8_t one_back[] = {0x00, 'a', 0x20, 0x00};  // a, then the byte 1 ago three times
  EXPECT_TRUE(LzfDecompress(one_back, sizeof(one_back), out, sizeof(out)));
  EXPECT_EQ(std::string(out, out + 4), "aaaa");
  const std::uint8_t two_back[] = {0x00, 'a', 0x20, 0x01};
  EXPECT_FALSE(LzfDecompress(two_back, sizeof(two_back), out, sizeof(out)));
}

}  // namespace
}  // namespace unlidar
