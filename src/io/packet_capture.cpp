#include "io/packet_capture.hpp"

#include <array>
#include <cstdint>

#include "base/recording.hpp"

namespace unlidar {
namespace {

constexpr std::size_t kIpHeaderBytes = 20;
constexpr std::size_t kUdpHeaderBytes = 8;
constexpr std::uint32_t kMaxSnapBytes = 1U << 16U;
constexpr std::size_t kCapturedBytesAt = 8;  // in the header of a record, behind the time

// Numbers written one behind the other.
template <std::size_t kBytes>
class Header {
 public:
  void PutLittle(std::uint32_t value, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i) Put(value >> (8 * i));
  }

  void PutBig(std::uint32_t value, std::size_t bytes) {
    for (std::size_t i = bytes; i-- > 0;) Put(value >> (8 * i));
  }

  // Replaces two bytes that are there.
  void SetBig(std::size_t at, std::uint16_t value) {
    bytes_[at] = static_cast<char>(value >> 8U);
    bytes_[at + 1] = static_cast<char>(value & 0xffU);
  }

  std::string_view bytes() const { return {bytes_.data(), used_}; }

 private:
  void Put(std::uint32_t value) { bytes_[used_++] = static_cast<char>(value & 0xffU); }

  std::array<char, kBytes> bytes_{};
  std::size_t used_ = 0;
};

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
  Header<kCaptureHeaderBytes> header;
  header.PutLittle(0xa1b23c4dU, 4);  // nanoseconds
  header.PutLittle(2, 2);            // version 2.4
  header.PutLittle(4, 2);
  header.PutLittle(0, 4);  // UTC
  header.PutLittle(0, 4);
  header.PutLittle(kMaxSnapBytes, 4);
  header.PutLittle(101, 4);  // LINKTYPE_RAW
  return std::string(header.bytes());
}

void AppendCaptureRecord(const Datagram& datagram, const LivoxEndpoint& receiver,
                         std::string& records) {
  constexpr std::size_t kHeaders = kIpHeaderBytes + kUdpHeaderBytes;
  constexpr std::size_t kIpChecksumAt = kCaptureRecordHeaderBytes + 10;
  const auto received_ns = static_cast<std::uint64_t>(datagram.received_ns);
  const auto sent_bytes = static_cast<std::uint32_t>(datagram.sent_bytes);
  Header<kCaptureRecordHeaderBytes + kHeaders> header;
  header.PutLittle(static_cast<std::uint32_t>(received_ns / kNsPerSecond), 4);
  header.PutLittle(static_cast<std::uint32_t>(received_ns % kNsPerSecond), 4);
  header.PutLittle(static_cast<std::uint32_t>(kHeaders + datagram.payload.size()), 4);
  header.PutLittle(kHeaders + sent_bytes, 4);
  header.PutBig(0x4500U, 2);  // version 4, 5 words
  header.PutBig(kHeaders + sent_bytes, 2);
  header.PutBig(0x4000U, 4);                  // no identification, do not fragment
  header.PutBig(64U << 24U | 17U << 16U, 4);  // time to live, UDP
  header.PutBig(datagram.source, 4);
  header.PutBig(receiver.address, 4);
  header.SetBig(kIpChecksumAt, InternetChecksum(header.bytes().substr(kCaptureRecordHeaderBytes)));
  header.PutBig(datagram.source_port, 2);
  header.PutBig(receiver.port, 2);
  header.PutBig(kUdpHeaderBytes + sent_bytes, 2);
  header.PutBig(0, 2);  // no checksum
  records += header.bytes();
  records += datagram.payload;
}

std::size_t CaptureRecordBytes(std::string_view header) {
  std::uint32_t captured = 0;
  for (std::size_t i = 0; i < 4; ++i) captured |= Byte(header, kCapturedBytesAt + i) << (8 * i);
  return kCaptureRecordHeaderBytes + captured;
}

}  // namespace unlidar
