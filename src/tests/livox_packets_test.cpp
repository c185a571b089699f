#include "io/livox_packets.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/livox_packet_writer.hpp"

namespace unlidar {
namespace {

using Millimetres = std::array<std::int32_t, 3>;
using Centimetres = std::array<std::int16_t, 3>;

std::string Spherical(std::uint32_t depth_mm, std::uint16_t theta, std::uint16_t phi) {
  std::string bytes;
  Put(bytes, depth_mm);
  Put(bytes, theta);
  Put(bytes, phi);
  return bytes + std::string(2, '\0');
}

void ExpectPoint(const LivoxPoint& point, std::uint32_t ray, double x, double y, double z) {
  EXPECT_EQ(point.ray, ray);
  EXPECT_NEAR(point.position_m.x(), x, 1e-5);
  EXPECT_NEAR(point.position_m.y(), y, 1e-5);
  EXPECT_NEAR(point.position_m.z(), z, 1e-5);
}

std::string ReasonOf(const std::string& payload) {
  try {
    ParseLivoxPacket(payload);
  } catch (const PacketError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

TEST(LivoxPacket, OfProtocol2HoldsMillimetres) {
  Header2 header;
  header.rays = 2;
  header.counter = 65535;
  header.frame = 9;
  const LivoxPacket packet = ParseLivoxPacket(Packet2(
      header, Cartesian(Millimetres{1234, -5678, 90}) + Cartesian(Millimetres{0, 0, 0}, 0x10)));
  EXPECT_EQ(packet.stamp_ns, 1'700'000'000'000'000'000);
  EXPECT_EQ(packet.span_ns, 475'000);
  EXPECT_EQ(packet.rays, 2U);
  EXPECT_EQ(packet.clock, LivoxClock::kSynchronised);
  ASSERT_TRUE(packet.counter);
  EXPECT_EQ(packet.counter->packet, 65535);
  EXPECT_EQ(packet.counter->frame, 9);
  ASSERT_EQ(packet.points.size(), 2U);
  ExpectPoint(packet.points[0], 0, 1.234, -5.678, 0.09);
  ExpectPoint(packet.points[1], 1, 0, 0, 0);
}

TEST(LivoxPacket, OfProtocol2HoldsCentimetresAnglesAndTwoReturns) {
  Header2 header;
  header.data_type = 2;
  LivoxPacket packet = ParseLivoxPacket(Packet2(header, Cartesian(Centimetres{-321, 40, 5})));
  ExpectPoint(packet.points.at(0), 0, -3.21, 0.4, 0.05);

  header.data_type = 3;
  packet = ParseLivoxPacket(Packet2(header, Spherical(20'000, 6000, 27'000)));
  ExpectPoint(packet.points.at(0), 0, 0, -20 * std::sqrt(0.75), 10);

  header.data_type = 17;
  packet = ParseLivoxPacket(
      Packet2(header, Cartesian(Millimetres{1000, 0, 0}) + Cartesian(Millimetres{2000, 0, 0})));
  ASSERT_EQ(packet.points.size(), 2U);
  ExpectPoint(packet.points[1], 0, 2, 0, 0);
}

TEST(LivoxPacket, OfAccelerationsHasNoRay) {
  Header2 header;
  header.data_type = 0;
  EXPECT_EQ(ParseLivoxPacket(Packet2(header, std::string(24, 'a'))).rays, 0U);
  Header1 first;
  first.data_type = 6;
  EXPECT_EQ(ParseLivoxPacket(Packet1(first, std::string(24, 'a'))).rays, 0U);
}

TEST(LivoxPacket, OfProtocol1HasARaysNumberByItsType) {
  struct Case {
    int type;
    std::size_t ray_bytes;
    std::uint32_t rays;
    std::size_t points;
  };
  for (const Case& c :
       {Case{0, 13, 100, 100}, Case{1, 9, 100, 100}, Case{2, 14, 96, 96}, Case{3, 10, 96, 96},
        Case{4, 28, 48, 96}, Case{5, 16, 48, 96}, Case{7, 42, 30, 90}, Case{8, 22, 30, 90}}) {
    Header1 header;
    header.data_type = static_cast<std::uint8_t>(c.type);
    const LivoxPacket packet =
        ParseLivoxPacket(Packet1(header, std::string(c.ray_bytes * c.rays, '\0')));
    EXPECT_EQ(packet.rays, c.rays) << c.type;
    EXPECT_EQ(packet.points.size(), c.points) << c.type;
    EXPECT_EQ(packet.points.back().ray, c.rays - 1) << c.type;
    EXPECT_FALSE(packet.counter);
    EXPECT_FALSE(packet.span_ns);
  }
}

TEST(LivoxPacket, OfProtocol1SharesTheAnglesOfARay) {
  std::string ray;
  Put(ray, std::uint16_t{9000});
  Put(ray, std::uint16_t{9000});
  for (const std::uint32_t depth_mm : {3000U, 5000U, 0U}) {
    Put(ray, depth_mm);
    ray += std::string(2, '\0');
  }
  Header1 header;
  header.data_type = 8;
  const LivoxPacket packet = ParseLivoxPacket(Packet1(header, Repeated(ray, 30)));
  ExpectPoint(packet.points.at(3), 1, 0, 3, 0);
  ExpectPoint(packet.points.at(4), 1, 0, 5, 0);
  ExpectPoint(packet.points.at(5), 1, 0, 0, 0);
}

TEST(LivoxPacket, LeavesOutWhatItsTagCallsNoise) {
  // In protocol 2 the value 2 of a group is the lowest confidence, in protocol 1 the value 1.
  Header2 header;
  header.rays = 5;
  std::string points;
  for (const int tag : {0x00, 0x02, 0x08, 0x05, 0x20}) {
    points += Cartesian(Millimetres{1000 + tag, 0, 0}, static_cast<std::uint8_t>(tag));
  }
  LivoxPacket packet = ParseLivoxPacket(Packet2(header, points));
  EXPECT_EQ(packet.noise_points, 2U);
  ASSERT_EQ(packet.points.size(), 3U);
  EXPECT_EQ(packet.points[1].ray, 3U);

  std::string rays = Repeated(Cartesian(Millimetres{1000, 0, 0}, 0x10), 94);
  rays += Cartesian(Millimetres{1, 0, 0}, 0x01) + Cartesian(Millimetres{1, 0, 0}, 0x04);
  packet = ParseLivoxPacket(Packet1({}, rays));
  EXPECT_EQ(packet.noise_points, 2U);
  EXPECT_EQ(packet.points.size(), 94U);
}

TEST(LivoxPacket, ReadsTheClocksOfBothProtocols) {
  Header2 header;
  header.time_type = 0;
  header.stamp_ns = 5'000'000'000;
  EXPECT_EQ(ParseLivoxPacket(Packet2(header, Cartesian(Millimetres{1, 1, 1}))).clock,
            LivoxClock::kPowerOn);

  const std::string points(std::size_t{14} * 96, '\0');
  Header1 first;
  first.time_type = 3;  // 29 February 2024, 13:59:59.999999
  first.stamp = 24 | 2U << 8U | 29U << 16U | 13ULL << 24U | 3'599'999'999ULL << 32U;
  const LivoxPacket packet = ParseLivoxPacket(Packet1(first, points));
  EXPECT_EQ(packet.stamp_ns, 1'709'215'199'999'999'000);
  EXPECT_EQ(packet.clock, LivoxClock::kSynchronised);
  first.stamp = 0 | 1U << 8U | 1U << 16U;  // 1 January 2000
  EXPECT_EQ(ParseLivoxPacket(Packet1(first, points)).stamp_ns, 946'684'800'000'000'000);
  first.stamp = 24 | 3U << 8U | 1U << 16U;  // 1 March 2024
  EXPECT_EQ(ParseLivoxPacket(Packet1(first, points)).stamp_ns, 1'709'251'200'000'000'000);
  first.stamp = 95 | 12U << 8U | 31U << 16U;
  EXPECT_EQ(ParseLivoxPacket(Packet1(first, points)).stamp_ns, 3'976'128'000'000'000'000);
}

TEST(LivoxPacket, IsRefusedWithAReason) {
  const std::string point = Cartesian(Millimetres{1, 2, 3});
  const std::string good = Packet2({}, point);
  EXPECT_EQ(ReasonOf(""), "is empty");
  EXPECT_EQ(ReasonOf("\xaa"), "begins with 170, expected the version 0 or 5 of point data");
  EXPECT_EQ(ReasonOf(good.substr(0, 35)), "has 35 bytes, expected a header of 36");
  EXPECT_EQ(ReasonOf(good + "x"), "has 51 bytes, expected 50 by its header");
  Header2 two;
  two.rays = 2;
  EXPECT_EQ(ReasonOf(Packet2(two, point)), "has 50 bytes, expected 64 by its header");
  std::string wrong_length = good;
  wrong_length[1] = 49;
  EXPECT_EQ(ReasonOf(wrong_length), "has 50 bytes, expected 49 by its header");
  Header2 type;
  type.data_type = 4;
  EXPECT_EQ(ReasonOf(Packet2(type, point)), "has the data type 4, expected 0 to 3, or 17");
  Header2 time;
  time.time_type = 3;
  EXPECT_EQ(ReasonOf(Packet2(time, point)), "has the time type 3, expected 0, 1 or 2");
  Header2 far;
  far.stamp_ns = ~0ULL;
  EXPECT_EQ(ReasonOf(Packet2(far, point)),
            "has the time 18446744073709551615 ns, expected a year up to 2096");
  Header2 angles;
  angles.data_type = 3;
  EXPECT_EQ(ReasonOf(Packet2(angles, Spherical(1, 18'001, 0))),
            "has a point at the angles 18001, 0, expected up to 18000 and 36000 hundredths of a "
            "degree");
  Header1 pulses;
  pulses.time_type = 4;
  const std::string points(std::size_t{14} * 96, '\0');
  EXPECT_EQ(ReasonOf(Packet1(pulses, points)), "has the time type 4, expected 0, 1 or 3");
  Header1 date;
  date.time_type = 3;
  date.stamp = 13U << 8U;
  EXPECT_EQ(ReasonOf(Packet1(date, points)),
            "has a date that is none, expected year, month, day, hour and microseconds");
  Header1 unknown;
  unknown.data_type = 9;
  EXPECT_EQ(ReasonOf(Packet1(unknown, points)), "has the data type 9, expected 0 to 8");
}

TEST(LivoxPacket, IsRefusedWhereAnyCheckedBitIsWrong) {
  const std::string good = Packet2({}, Cartesian(Millimetres{1, 2, 3}));
  for (std::size_t bit = 8 * std::size_t{24}; bit < 8 * good.size(); ++bit) {
    std::string bad = good;
    bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << (bit % 8)));
    EXPECT_THROW(ParseLivoxPacket(bad), PacketError) << bit;
  }
  std::string unchecked = good;
  unchecked.replace(24, 4, 4, '\0');  // a sensor that does not give the sum
  EXPECT_EQ(ParseLivoxPacket(unchecked).points.size(), 1U);
}

TEST(LivoxPacket, IsRefusedAtAnyOtherLength) {
  Header1 spherical;
  spherical.data_type = 5;
  for (const std::string& good : {Packet2({}, Cartesian(Millimetres{1, 2, 3})),
                                  Packet1(spherical, std::string(std::size_t{16} * 48, '\0'))}) {
    for (std::size_t size = 0; size < good.size(); ++size) {
      EXPECT_THROW(ParseLivoxPacket(std::string_view(good).substr(0, size)), PacketError) << size;
    }
  }
}

}  // namespace
}  // namespace unlidar
