#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <string>
#include <vector>

#include "app/packet_recorder.hpp"
#include "tests/temporary_folder.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;
using ::unlidar::testing::TemporaryFolder;

constexpr CaptureLimits kLimits = {20'000, 50'000};

// Of a packet that has its number as payload, `bytes` long.
std::string Record(int number, std::size_t bytes = 1000) {
  Datagram datagram;
  datagram.source = 0xc0a8010c;
  datagram.source_port = 56300;
  datagram.received_ns = 1'706'300'000'123'456'789;
  datagram.payload = std::to_string(number);
  datagram.payload.resize(bytes, ' ');
  datagram.sent_bytes = bytes;
  std::string records;
  AppendCaptureRecord(datagram, {0xc0a80105, 56301}, records);
  return records;
}

std::string Records(int begin, int end) {
  std::string records;
  for (int k = begin; k < end; ++k) records += Record(k);
  return records;
}

std::vector<fs::path> FilesIn(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".pcap") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string Bytes(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::uint64_t TotalBytes(const fs::path& folder) {
  const std::vector<fs::path> files = FilesIn(folder);
  return std::accumulate(files.begin(), files.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const fs::path& f) { return sum + file_size(f); });
}

// The numbers of the packets of all files. Each file must hold whole packets.
std::vector<int> NumbersIn(const fs::path& folder) {
  constexpr std::size_t kHeaders = kCaptureRecordHeaderBytes + 28;
  std::vector<int> numbers;
  for (const fs::path& path : FilesIn(folder)) {
    const std::string bytes = Bytes(path);
    EXPECT_EQ(bytes.substr(0, kCaptureHeaderBytes), CaptureHeader());
    std::size_t at = kCaptureHeaderBytes;
    while (at < bytes.size()) {
      numbers.push_back(std::stoi(bytes.substr(at + kHeaders)));
      at += CaptureRecordBytes(bytes.substr(at));
    }
    EXPECT_EQ(at, bytes.size()) << path;
  }
  return numbers;
}

std::vector<int> Range(int begin, int end) {
  std::vector<int> numbers(static_cast<std::size_t>(end - begin));
  std::iota(numbers.begin(), numbers.end(), begin);
  return numbers;
}

// Of headers as RFC 1071 checks them: the sum with the checksum in it is all ones.
TEST(PacketCapture, ARecordIsAPacketWithTheHeadersThatItHad) {
  const std::string record = Record(7);
  ASSERT_EQ(record.size(), 16U + 20U + 8U + 1000U);
  EXPECT_EQ(CaptureRecordBytes(record), record.size());
  std::uint32_t sum = 0;
  const auto byte = [&](std::size_t at) {
    return std::uint32_t{static_cast<std::uint8_t>(record[at])};
  };
  for (std::size_t at = 16; at < 36; at += 2) sum += byte(at) << 8U | byte(at + 1);
  EXPECT_EQ((sum & 0xffffU) + (sum >> 16U), 0xffffU);
  EXPECT_EQ(byte(18) << 8U | byte(19), 1028U);  // length
  EXPECT_EQ(record.substr(28, 8), "\xc0\xa8\x01\x0c\xc0\xa8\x01\x05");
  EXPECT_EQ(byte(36) << 8U | byte(37), 56300U);
  EXPECT_EQ(byte(38) << 8U | byte(39), 56301U);
  EXPECT_EQ(byte(4) | byte(5) << 8U | byte(6) << 16U | byte(7) << 24U, 123'456'789U);
}

TEST(CaptureFiles, HoldTheNewestPacketsInOrderWithinTheirBounds) {
  const TemporaryFolder folder;
  const std::vector<std::string> others = {"packets_of_mine.pcap",
                                           "packets_00000007.txt",
                                           "packets_00000001_mine.pcap",
                                           "packets_1_20260126T000000Z.pcap",
                                           "packets_.pcap",
                                           "packets_99999999999999999999_20260126T000000Z.pcap",
                                           "eth0_00000001_20260126T000000Z.pcap"};
  for (const std::string& name : others) folder.Write(name, "mine");
  CaptureFiles files(folder.path(), kLimits);
  for (int k = 0; k < 200; ++k) {
    files.Write(Record(k));
    EXPECT_LE(files.total_bytes(), kLimits.total_bytes);
    EXPECT_LE(TotalBytes(folder.path()), kLimits.total_bytes + 4 * others.size());
  }
  EXPECT_EQ(files.packets(), 200U);
  for (const std::string& name : others) {
    EXPECT_EQ(Bytes(folder / name), "mine");
    fs::remove(folder / name);
  }
  for (const fs::path& path : FilesIn(folder.path())) {
    EXPECT_LE(fs::file_size(path), kLimits.file_bytes);
  }
  const std::vector<int> numbers = NumbersIn(folder.path());
  EXPECT_GE(numbers.size(), 28U);  // the limits less one file
  EXPECT_EQ(numbers, Range(200 - static_cast<int>(numbers.size()), 200));
}

TEST(CaptureFiles, HowPacketsAreHandedInMakesNoDifference) {
  const TemporaryFolder one_by_one;
  const TemporaryFolder at_once;
  CaptureFiles a(one_by_one.path(), kLimits);
  for (int k = 0; k < 200; ++k) a.Write(Record(k));
  CaptureFiles b(at_once.path(), kLimits);
  b.Write(Records(0, 200));
  EXPECT_EQ(NumbersIn(one_by_one.path()), NumbersIn(at_once.path()));
}

TEST(CaptureFiles, ALaterRunGoesOnBehindTheEarlierOneAndWithinTheSameBounds) {
  const TemporaryFolder folder;
  for (int run = 0; run < 10; ++run) {
    CaptureFiles files(folder.path(), kLimits);
    EXPECT_EQ(files.total_bytes(), TotalBytes(folder.path()));
    files.Write(Records(10 * run, 10 * run + 10));
    EXPECT_LE(TotalBytes(folder.path()), kLimits.total_bytes);
  }
  const std::vector<int> numbers = NumbersIn(folder.path());
  EXPECT_EQ(numbers, Range(100 - static_cast<int>(numbers.size()), 100));
  EXPECT_GE(numbers.size(), 40U);
}

TEST(CaptureFiles, WhatAKilledRunCouldNotFinishIsCutOff) {
  for (const std::size_t lost : {1U, 500U, 1043U, 1044U, 1045U, 2088U, 2100U, 2112U}) {
    const TemporaryFolder folder;
    { CaptureFiles(folder.path(), kLimits).Write(Records(0, 2)); }
    const fs::path torn = FilesIn(folder.path()).front();
    fs::resize_file(torn, fs::file_size(torn) - lost);
    CaptureFiles files(folder.path(), kLimits);
    EXPECT_EQ(files.total_bytes(), TotalBytes(folder.path()));
    files.Write(Records(2, 3));
    const std::vector<int> expected = lost <= 1044 ? std::vector{0, 2} : std::vector{2};
    EXPECT_EQ(NumbersIn(folder.path()), expected) << lost;
  }
}

TEST(CaptureFiles, ADiskThatFailsLosesPacketsAndTearsNone) {
  std::signal(SIGXFSZ, SIG_IGN);  // as in a live run
  const TemporaryFolder folder;
  CaptureFiles files(folder.path(), kLimits);
  files.Write(Records(0, 3));
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  // None of the next, a part of one, and not even the header of another file.
  for (const rlim_t bytes : {rlim_t{24 + 3 * 1044}, rlim_t{4000}, rlim_t{10}}) {
    const rlimit limit{bytes, before.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    if (bytes == 10) fs::remove(FilesIn(folder.path()).front());
    EXPECT_THROW(files.Write(Records(50, 60)), OutputError);
    ::setrlimit(RLIMIT_FSIZE, &before);
    EXPECT_EQ(NumbersIn(folder.path()), bytes == 10 ? Range(0, 0) : Range(0, 3));
  }
  files.Write(Records(3, 6));
  EXPECT_EQ(NumbersIn(folder.path()), Range(3, 6));
  EXPECT_EQ(files.packets(), 6U);
}

TEST(CaptureFiles, AreOfOneProcessInAFolderThatCanBeWritten) {
  const TemporaryFolder folder;
  const CaptureFiles files(folder / "new", kLimits);
  EXPECT_TRUE(fs::is_directory(folder / "new"));
  EXPECT_THROW(CaptureFiles(folder / "new", kLimits), OutputError);
  EXPECT_THROW(CaptureFiles(folder / "no/new", kLimits), OutputError);
  folder.Write("file", "mine");
  EXPECT_THROW(CaptureFiles(folder / "file", kLimits), OutputError);
}

}  // namespace
}  // namespace unlidar
