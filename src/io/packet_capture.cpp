#include "io/packet_capture.hpp"

#include <cstdint>

#include "base/recording.hpp"

namespace unlidar {
namespace {

constexpr std::size_t kIpHeaderBytes = 20;
constexpr std::size_t kUdpHeaderBytes = 8;
constexpr std::uint32_t kMaxSnapBytes = 1U << 16U;
constexpr std::size_t kCapturedBytesAt = 8;  // in the header of a record, behind the time

void PutLittle(std::uint32_t value, std::size_t bytes, std::string& to) {
  for (std::size_t i = 0; i < bytes; ++i) to += static_cast<char>((value >> (8 * i)) & 0xffU);
}

void PutBig(std::uint32_t value, std::size_t bytes, std::string& to) {
  for (std::size_t i = bytes; i-- > 0;) to += static_cast<char>((value >> (8 * i)) & 0xffU);
}

std::uint32_t Byte(std::string_view text, std::size_t at) {
  return static_cast<std::uint8_t>(text[at]);
}

// RFC 1071, of an even number of bytes.
std::uint16_t InternetChecksum(std::string_view header) {
  std::uint32_t sum = 0;
  for (std::size_t at = 0; at < header.size(); at += 2) {
    sum += Byte(header, at) << 8U | Byte(header, at + 1);
  }
  while (sum > 0xffffU) sum = (sum & 0xffffU) + (sum >> 16U);
  return static_cast<std::uint16_t>(~sum);
}

}  // namespace

std::string CaptureHeader() {
  std::string header;
  PutLittle(0xa1b23c4dU, 4, header);  // nanoseconds
  PutLittle(2, 2, header);            // version 2.4
  PutLittle(4, 2, header);
  PutLittle(0, 4, header);  // UTC
  PutLittle(0, 4, header);
  PutLittle(kMaxSnapBytes, 4, header);
  PutLittle(101, 4, header);  // LINKTYPE_RAW
  return header;
}

void AppendCaptureRecord(const Datagram& datagram, const LivoxEndpoint& receiver,
                         std::string& records) {
  constexpr std::size_t kHeaders = kIpHeaderBytes + kUdpHeaderBytes;
  const auto received_ns = static_cast<std::uint64_t>(datagram.received_ns);
  const auto sent_bytes = static_cast<std::uint32_t>(datagram.sent_bytes);
  PutLittle(static_cast<std::uint32_t>(received_ns / kNsPerSecond), 4, records);
  PutLittle(static_cast<std::uint32_t>(received_ns % kNsPerSecond), 4, records);
  PutLittle(static_cast<std::uint32_t>(kHeaders + datagram.payload.size()), 4, records);
  PutLittle(kHeaders + sent_bytes, 4, records);
  const std::size_t ip_at = records.size();
  PutBig(0x4500U, 2, records);  // version 4, 5 words
  PutBig(kHeaders + sent_bytes, 2, records);
  PutBig(0x4000U, 4, records);                  // no identification, do not fragment
  PutBig(64U << 24U | 17U << 16U, 4, records);  // time to live, UDP
  PutBig(datagram.source, 4, records);
  PutBig(receiver.address, 4, records);
  const std::string_view written = records;
  const std::uint16_t checksum = InternetChecksum(written.substr(ip_at));
  records[ip_at + 10] = static_cast<char>(checksum >> 8U);
  records[ip_at + 11] = static_cast<char>(checksum & 0xffU);
  PutBig(datagram.source_port, 2, records);
  PutBig(receiver.port, 2, records);
  PutBig(kUdpHeaderBytes + sent_bytes, 2, records);
  PutBig(0, 2, records);  // no checksum
  records += datagram.payload;
}

std::size_t CaptureRecordBytes(std::string_view header) {
  std::uint32_t captured = 0;
  for (std::size_t i = 0; i < 4; ++i) captured |= Byte(header, kCapturedBytesAt + i) << (8 * i);
  return kCaptureRecordHeaderBytes + captured;
}

}  // namespace unlidar
