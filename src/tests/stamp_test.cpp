#include "io/stamp.hpp"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <string>

namespace unlidar {
namespace {

TEST(ParseStamp, SecondsWithAPointOrAnExponentAreExact) {
  const std::map<std::string, TimeNs> stamps = {
      {"1706255621.614239", 1'706'255'621'614'239'000},
      {"1706255621.614239001", 1'706'255'621'614'239'001},
      {"1.706255621614239001e+09", 1'706'255'621'614'239'001},
      {"1706255621614.239001E-3", 1'706'255'621'614'239'001},
      {"0.1", 100'000'000},
      {".5", 500'000'000},
      {"5.", 5'000'000'000},
      {"000.000000001", 1},
      {"-0.25", -250'000'000},
      {"0.0", 0},
      {"0.0000000014999", 1},
      {"0.0000000015", 2},
      {"0.9999999999", 1'000'000'000},
      {"1e-10", 0},
      {"5e-10", 1},
      {"9223372036.854775807", 9'223'372'036'854'775'807}};
  for (const auto& [text, stamp_ns] : stamps) EXPECT_EQ(ParseStamp(text), stamp_ns) << text;
}

TEST(ParseStamp, WholeNumbersHaveTheUnitOfTheirMagnitude) {
  const TimeNs second_ns = 1'706'255'621'000'000'000;
  EXPECT_EQ(ParseStamp("1706255621"), second_ns);
  EXPECT_EQ(ParseStamp("1706255621614"), second_ns + 614'000'000);
  EXPECT_EQ(ParseStamp("1706255621614239"), second_ns + 614'239'000);
  EXPECT_EQ(ParseStamp("1706255621614239001"), second_ns + 614'239'001);
  EXPECT_EQ(ParseStamp("0"), 0);
  EXPECT_EQ(ParseStamp("0007"), 7'000'000'000);
  EXPECT_EQ(ParseStamp("-7"), -7'000'000'000);
}

TEST(ParseStamp, EverythingElseIsNoStamp) {
  for (const char* text :
       {"", ".", "-", "+1", "1 ", " 1", "1.2.3", "1,5", "abc", "1a", "1e", "e5", "1e+", "1e1.5",
        "1e+-5", "1e++5", "nan", "inf", "0x10", "--1", "99999999999", "1e10",
        "9223372036.854775808", "1e999999999999",
        // 2^64 - 1 and a half: rounding up must not begin at 0 again.
        "18446744073.7095516155", "9223372036.8547758075", "99999999999999999999999999"}) {
    EXPECT_EQ(ParseStamp(text), std::nullopt) << text;
  }
  EXPECT_EQ(ParseStamp(std::string(1'000'000, '1')), std::nullopt);
}

TEST(ParseStamp, PrintedNanosecondsComeBack) {
  std::mt19937_64 generator(1);
  for (int trial = 0; trial < 10'000; ++trial) {
    const auto stamp_ns = static_cast<TimeNs>(generator() >> (1 + generator() % 40));
    std::string fraction = std::to_string(stamp_ns % 1'000'000'000);
    fraction.insert(0, 9 - fraction.size(), '0');
    EXPECT_EQ(ParseStamp(std::to_string(stamp_ns / 1'000'000'000) + "." + fraction), stamp_ns);
  }
}

}  // namespace
}  // namespace unlidar
