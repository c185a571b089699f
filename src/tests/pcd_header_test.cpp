// Headers and text data: what is accepted, and what is refused with which message.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>

#include "io/pcd.hpp"
#include "tests/pcd_oracle.hpp"
#include "tests/pcd_writer.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using testing::TemporaryFolder;

std::string MessageOf(const std::string& bytes) {
  try {
    ParsePcd(bytes, "frame.pcd");
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

std::string Header(const std::string& data, const std::string& points = "2") {
  return "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " + points +
         "\nHEIGHT 1\nPOINTS " + points + "\nDATA " + data + "\n";
}

const std::vector<Eigen::Vector3f> kTwoPoints = {{1.0F, 2.0F, 3.0F}, {-4.5F, 5.25F, 6e3F}};

TEST(PcdHeaders, TheSamePointsWhateverTheLineEndsBlanksAndOrder) {
  const std::string rows = "1 2 3\n-4.5 5.25 6e3\n";
  const std::map<std::string, std::string> files = {
      {"plain", Header("ascii") + rows},
      {"no version",
       "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n"
       "DATA ascii\n" +
           rows},
      {"no size, type, count", "FIELDS x y z\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n" + rows},
      {"no height", "FIELDS x y z\nWIDTH 2\nPOINTS 2\nDATA ascii\n" + rows},
      {"no width and height", "FIELDS x y z\nPOINTS 2\nDATA ascii\n" + rows},
      {"organised", "FIELDS x y z\nWIDTH 1\nHEIGHT 2\nPOINTS 2\nDATA ascii\n" + rows},
      {"columns", "COLUMNS x y z\nPOINTS 2\nDATA ascii\n" + rows},
      {"comments", "# a\n#b\n\n" + Header("ascii") + rows},
      {"tabs", "FIELDS\tx  y\t\tz\nPOINTS \t2\nDATA\tascii\n  1\t 2   3  \n-4.5\t5.25 6e3\n"},
      {"more rows than points", Header("ascii") + rows + "7 8 9\n"},
      {"no last line end", Header("ascii") + "1 2 3\n-4.5 5.25 6e3"}};
  const TemporaryFolder folder;
  for (const auto& [what, bytes] : files) {
    SCOPED_TRACE(what);
    EXPECT_EQ(ParsePcd(bytes, "f").points_m, kTwoPoints);
    const auto blob = testing::PclBlob(folder.Write("file.pcd", bytes));
    ASSERT_TRUE(blob);
    EXPECT_EQ(testing::PclPointsOfAnyType(*blob), kTwoPoints);

    std::string crlf;
    for (const char c : bytes) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
    EXPECT_EQ(ParsePcd(crlf, "f").points_m, kTwoPoints);
  }
}

TEST(PcdHeaders, BlankLinesBetweenRowsAreNoPoints) {
  // PCL takes a line that holds only blanks for a point at (0, 0, 0).
  EXPECT_EQ(ParsePcd(Header("ascii") + "\n1 2 3\n \t\r\n\n-4.5 5.25 6e3\n", "f").points_m,
            kTwoPoints);
}

TEST(PcdHeaders, BinaryDataMayFollowACarriageReturnAndBeFollowedByBytes) {
  std::string bytes = BinaryPcd(kTwoPoints) + "rest";
  bytes.replace(bytes.find("DATA binary\n"), 12, "DATA binary\r\n");
  EXPECT_EQ(ParsePcd(bytes, "f").points_m, kTwoPoints);
}

TEST(PcdHeaders, WrongEntriesAreRefusedWithTheirValue) {
  const std::string rows = "1 2 3\n4 5 6\n";
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string bytes = Header("ascii") + rows;
    return bytes.replace(bytes.find(from), from.size(), to);
  };
  const std::map<std::string, std::string> expected_by_file = {
      {with("VERSION 0.7", "VERSION 0.8"), "'0.8'"},
      {with("VERSION 0.7", "VERSION"), "VERSION is ''"},
      {with("FIELDS x y z\n", ""), "no FIELDS"},
      {with("FIELDS x y z", "FIELDS x w z"), "'x w z', expected a field y"},
      {with("FIELDS x y z", "FIELDS x y z i"), "SIZE has 3 values"},
      {with("SIZE 4 4 4", "SIZE 4 4 3"), "'z' has TYPE 'F' and SIZE 3"},
      {with("SIZE 4 4 4", "SIZE 4 4 -4"), "SIZE is '-4'"},
      {with("TYPE F F F", "TYPE F Q F"), "TYPE 'Q'"},
      {with("TYPE F F F", "TYPE F F"), "TYPE has 2 values"},
      {with("COUNT 1 1 1", "COUNT 1 2 1"), "'y' has COUNT 2"},
      {with("COUNT 1 1 1", "COUNT 1 1 99999999999"), "'99999999999'"},
      {with("WIDTH 2", "WIDTH 3"), "is 3 and POINTS is 2"},
      {with("WIDTH 2", "WIDTH two"), "'two'"},
      {with("WIDTH 2", "WIDTH 2\nWIDTH 2"), "twice"},
      {with("HEIGHT 1", "HEIGHT 1 1"), "HEIGHT has 2 values"},
      {with("POINTS 2", "POINTS -2"), "'-2'"},
      {with("DATA ascii", "DATA text"), "'text'"},
      {with("DATA ascii", "DATE ascii"), "line 9 begins with 'DATE'"},
      {with("4 5 6", "44 55"), "line 11: too few values, expected 3"},
      {with("4 5 6", "4 5 6 7"), "line 11: too many values, expected 3"},
      {with("4 5 6", "4 five 6"), "line 11: field 'y' is 'five'"},
      {with("4 5 6\n", "          \n"), "ends after 1 points, expected 2"},
      {with("4 5 6\n", ""), "has 6 bytes, expected at least 11"},
      {Header("binary") + std::string(23, 'a'), "has 23 bytes, expected 24"},
      {Header("binary_compressed") + "1234567", "has 7 bytes"},
      {Header("binary_compressed") + testing::WithSizes(std::string(9, 'a'), 25),
       "unpacks to 25 bytes, expected 24"},
      {Header("binary_compressed") + testing::WithSizes(std::string(9, 'a'), 24), "corrupt"},
      {Header("binary_compressed", "1000") + testing::WithSizes(std::string(9, 'a'), 12000),
       "at most 88 times"}};
  for (const auto& [bytes, expected] : expected_by_file) {
    const std::string message = MessageOf(bytes);
    EXPECT_EQ(message.rfind("frame.pcd: ", 0), 0U) << expected;
    EXPECT_NE(message.find(expected), std::string::npos) << message << " | " << expected;
    EXPECT_NE(message.find("expected"), std::string::npos) << message;
  }
}

TEST(PcdHeaders, MessagesStayPrintableAndShort) {
  const std::string message = MessageOf(std::string(1'000'000, '\x01'));
  EXPECT_LT(message.size(), 300U);
  EXPECT_EQ(std::count_if(message.begin(), message.end(), [](char c) { return c < ' '; }), 0);
}

TEST(PcdNumbers, TextIsReadToTheBitAsPclReadsIt) {
  const std::vector<std::string> numbers = {"0",
                                            "-0",
                                            "1",
                                            "+1",
                                            "1.",
                                            ".5",
                                            "1e3",
                                            "1E-3",
                                            "0.1",
                                            "16777217",
                                            "3.4028235e38",
                                            "1e-45",
                                            "1.1754942e-38",
                                            "nan",
                                            "NaN",
                                            "NAN",
                                            "inf",
                                            "-inf",
                                            "1e39",
                                            "-1e39",
                                            "1e400",
                                            "1e-400",
                                            "0.30000001192092896",
                                            "123456789.123456789",
                                            "8.5899346e9",
                                            "-1.17549435E-38"};
  const TemporaryFolder folder;
  std::string rows;
  for (const std::string& number : numbers) rows += number + " 0 " + number + "\n";
  const std::string bytes = Header("ascii", std::to_string(numbers.size())) + rows;
  const auto blob = testing::PclBlob(folder.Write("numbers.pcd", bytes));
  ASSERT_TRUE(blob);
  const std::vector<Eigen::Vector3f> oracle = testing::PclPointsOfAnyType(*blob);
  const std::vector<Eigen::Vector3f> points_m = ParsePcd(bytes, "f").points_m;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    EXPECT_TRUE(testing::SamePoints({points_m[i]}, {oracle[i]}))
        << numbers[i] << ": " << points_m[i].transpose() << ", PCL: " << oracle[i].transpose();
  }
  for (const char* wrong : {"abc", "1a", "1,5", "--1", "+-1", "+", "-", "e5", "0x10", "1.2.3"}) {
    EXPECT_NE(MessageOf(Header("ascii", "1") + wrong + " 0 0\n"), "") << wrong;
  }
}

}  // namespace
}  // namespace unlidar
