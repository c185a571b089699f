#include "io/frame_messages.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

struct Got {
  std::string sensor;
  TimeNs stamp_ns;
  std::string name;
  std::string pcd;

  bool operator==(const Got& other) const {
    return sensor == other.sensor && stamp_ns == other.stamp_ns && name == other.name &&
           pcd == other.pcd;
  }
};

// All messages of the bytes, handed in in pieces of this size.
std::vector<Got> ReadAll(const std::string& bytes, std::size_t piece) {
  const Config config;
  FrameMessageReader reader("stdin", config);
  std::vector<Got> messages;
  const std::string_view all = bytes;
  for (std::size_t at = 0; at < bytes.size(); at += piece) {
    reader.Append(all.substr(at, piece));
    while (const auto message = reader.Next()) {
      messages.push_back(
          {message->sensor, message->stamp_ns, message->name, std::string(message->pcd)});
    }
  }
  reader.Finish();
  return messages;
}

std::string ReasonOf(const std::string& bytes) {
  std::string reason;
  for (const std::size_t piece : {bytes.size(), std::size_t{1}}) {
    try {
      ReadAll(bytes, piece);
      ADD_FAILURE() << "no error";
    } catch (const InputError& error) {
      reason = error.what();
      EXPECT_LT(reason.size(), 250U);
      EXPECT_EQ(reason.find('\n'), std::string::npos);
    }
  }
  return reason;
}

const std::string kStream = std::string("frame mid360 1706255621.600227 5\nab\ncd") +
                            "frame avia 1706255621600 0\n" + "frame mid360 -1.5 6\nframe " +
                            "frame a-B_9 1706255621600227001 1\n\n";

TEST(FrameMessages, AreTheSameInPiecesOfAnySize) {
  const std::vector<Got> expected = {
      {"mid360", 1'706'255'621'600'227'000, "stdin: message 1 (mid360 1706255621.600227)",
       "ab\ncd"},
      {"avia", 1'706'255'621'600'000'000, "stdin: message 2 (avia 1706255621600)", ""},
      {"mid360", -1'500'000'000, "stdin: message 3 (mid360 -1.5)", "frame "},
      {"a-B_9", 1'706'255'621'600'227'001, "stdin: message 4 (a-B_9 1706255621600227001)", "\n"}};
  for (std::size_t piece = 1; piece <= kStream.size(); ++piece) {
    EXPECT_EQ(ReadAll(kStream, piece), expected) << piece;
  }
}

TEST(FrameMessages, AnEmptyStreamHasNone) { EXPECT_TRUE(ReadAll("", 1).empty()); }

TEST(FrameMessages, AStreamThatEndsWithinAMessageIsTold) {
  for (std::size_t size = 1; size < kStream.size(); ++size) {
    const std::string cut = kStream.substr(0, size);
    const bool is_whole = size == 38 || size == 65 || size == 91;
    if (is_whole) {
      EXPECT_NO_THROW(ReadAll(cut, size)) << size;
    } else {
      EXPECT_THROW(ReadAll(cut, size), InputError) << size;
    }
  }
  EXPECT_EQ(ReasonOf(kStream.substr(0, 36)),
            "stdin: message 1 ends after 3 bytes of the PCD of mid360 1706255621.600227, "
            "expected 5");
  EXPECT_EQ(ReasonOf(kStream.substr(0, 45)),
            "stdin: message 2 ends within its line: 'frame a', expected a line 'frame NAME STAMP "
            "LENGTH'");
}

TEST(FrameMessages, GarbageIsToldWithItsNumberAndWhatWasExpected) {
  EXPECT_EQ(ReasonOf("frame a 1 1\nxyz\n"),
            "stdin: message 2 begins with 'y', expected a line 'frame NAME STAMP LENGTH'");
  EXPECT_EQ(ReasonOf("frame a 1\n"),
            "stdin: message 1 has the line 'frame a 1', expected a line 'frame NAME STAMP LENGTH' "
            "with one space between two");
  EXPECT_EQ(ReasonOf("frame a  1 2\n").find("stdin: message 1 has the line 'frame a  1 2', "), 0U);
  EXPECT_EQ(ReasonOf("frame a/b 1 2\n"),
            "stdin: message 1 has the NAME 'a/b', expected a name of up to 120 letters, digits, "
            "'_' and '-'");
  EXPECT_EQ(ReasonOf("frame a soon 2\n").find("stdin: message 1 has the STAMP 'soon', expected"),
            0U);
  EXPECT_EQ(ReasonOf("frame a 1e30 2\n").find("stdin: message 1 has the STAMP '1e30', expected"),
            0U);
  for (const std::string length :
       {"", "-1", "+1", "0x10", "1.0", "2\r", "268435457", "99999999999999999999999999"}) {
    EXPECT_NE(ReasonOf("frame a 1 " + length + "\n").find("expected a number of bytes up to 2684"),
              std::string::npos)
        << length;
  }
}

TEST(FrameMessages, GarbageIsToldAtItsFirstByte) {
  const Config config;
  FrameMessageReader reader("stdin", config);
  reader.Append("\x7f");
  try {
    reader.Next();
    ADD_FAILURE() << "no error";
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()),
              "stdin: message 1 begins with '?', expected a line 'frame NAME STAMP LENGTH'");
  }
}

TEST(FrameMessages, ALineIsBounded) {
  const std::string reason = ReasonOf("frame " + std::string(3'000'000, 'x'));
  EXPECT_NE(reason.find("no newline within 512 bytes"), std::string::npos) << reason;
}

}  // namespace
}  // namespace unlidar
