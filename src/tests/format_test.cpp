#include "base/format.hpp"

#include <gtest/gtest.h>

#include <string>

namespace unlidar {
namespace {

TEST(Quoted, ShowsPrintableTextAsItIs) {
  EXPECT_EQ(Quoted(""), "''");
  EXPECT_EQ(Quoted("max range: 'far' ~"), "'max range: 'far' ~'");
  EXPECT_EQ(Quoted("Höhe 三 🚁"), "'Höhe 三 🚁'");
}

TEST(Quoted, HidesWhatATerminalWouldObeyAndWhatIsNoText) {
  EXPECT_EQ(Quoted(std::string("a\0\n\t\x1b[31m\x7f", 10)), "'a????[31m?'");
  EXPECT_EQ(Quoted("\x80\xff\xc3"),
            "'??"
            "?'");
  EXPECT_EQ(Quoted("\xc2\x9b"),
            "'?"
            "?'");                          // a control character in UTF-8
  EXPECT_EQ(Quoted("\xe4\xb8z"), "'??z'");  // a character that is cut off
  EXPECT_EQ(Quoted("\xc3\xb6\xb6"), "'\xc3\xb6?'");
}

TEST(Shortened, CutsBetweenCharacters) {
  EXPECT_EQ(Shortened("abcd", 4), "abcd");
  EXPECT_EQ(Shortened("abcde", 4), "abcd...");
  EXPECT_EQ(Shortened("abc\xc3\xb6", 4), "abc...");
  EXPECT_EQ(Shortened("ab\xc3\xb6", 4), "ab\xc3\xb6");
  EXPECT_EQ(Quoted(std::string(3'000'000, 'x')), "'" + std::string(80, 'x') + "...'");
}

}  // namespace
}  // namespace unlidar
