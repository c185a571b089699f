// UDP packets in the classic capture format that tcpdump and Wireshark read: little-endian, times
// in nanoseconds, raw IP (LINKTYPE_RAW). IPv4 and UDP headers are made anew.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "io/livox_receiver.hpp"

namespace unlidar {

// Returns the file header of a capture.
std::string CaptureHeader();

inline constexpr std::size_t kCaptureHeaderBytes = 24;
inline constexpr std::size_t kCaptureRecordHeaderBytes = 16;

// Appends the record of a packet that came to `receiver`. A packet that was cut off on reception
// has the length that it had in its headers.
void AppendCaptureRecord(const Datagram& datagram, const LivoxEndpoint& receiver,
                         std::string& records);

// Returns the size of the record that begins with `header`, of kCaptureRecordHeaderBytes or more.
std::size_t CaptureRecordBytes(std::string_view header);

}  // namespace unlidar
