#include "app/packet_recorder.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <iomanip>
#include <regex>
#include <sstream>
#include <utility>

#include "app/output_files.hpp"
#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "base/recording.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kWriteInterval(1);

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

// Returns the number in a name that NameOf() gives; files with other names are somebody else's.
std::optional<std::uint64_t> NumberOf(const std::string& name) {
  static const std::regex kForm("packets_([0-9]{8,15})_[0-9]{8}T[0-9]{6}Z[.]pcap");
  std::smatch parts;
  if (!std::regex_match(name, parts, kForm)) return std::nullopt;
  return ParseNumber<std::uint64_t>(parts[1].str());
}

// The time is for people: the numbers are in order whatever the clock does.
std::string NameOf(std::uint64_t number) {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::ostringstream name;
  name.exceptions(std::ios::badbit);  // a stream hides that memory has run out
  name << "packets_" << std::setfill('0') << std::setw(8) << number
       << std::put_time(&utc, "_%Y%m%dT%H%M%SZ.pcap");
  return name.str();
}

// Returns the bytes of whole records behind the header; 0 without a header.
std::uint64_t WholeBytes(int fd, std::uint64_t bytes) {
  if (bytes < kCaptureHeaderBytes) return 0;
  std::uint64_t whole = kCaptureHeaderBytes;
  std::array<char, kCaptureRecordHeaderBytes> header{};
  while (Uninterrupted([&] {
           return ::pread(fd, header.data(), header.size(), static_cast<off_t>(whole));
         }) == static_cast<ssize_t>(header.size())) {
    const std::size_t record = CaptureRecordBytes({header.data(), header.size()});
    if (record > bytes - whole) break;
    whole += record;
  }
  return whole;
}

int OpenFolder(const std::string& directory) {
  ::mkdir(directory.c_str(), 0777);
  return ::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
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
  return kCaptureRecordHeaderBytes + LoadAs<std::uint32_t>(header.data() + kCapturedBytesAt);
}

CaptureFiles::CaptureFiles(std::string directory, CaptureLimits limits)
    : directory_(std::move(directory)), limits_(limits), lock_(OpenFolder(directory_)) {
  if (!lock_.is_open()) FailToWrite(directory_);
  CheckWritable(directory_ + "/" + NameOf(next_number_));
  if (::flock(lock_.get(), LOCK_EX | LOCK_NB) != 0) {
    FailToWrite(directory_, "another process records to it, expected a folder of its own");
  }
  FindEarlierFiles();
}

void CaptureFiles::FindEarlierFiles() {
  std::error_code error;
  for (fs::directory_iterator entry(directory_, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::optional<std::uint64_t> number = NumberOf(entry->path().filename().string());
    std::error_code unknown;
    if (!number || !entry->is_regular_file(unknown)) continue;
    const std::uint64_t bytes = entry->file_size(unknown);
    if (!unknown) files_.push_back({*number, entry->path().string(), bytes});
  }
  if (error) FailToWrite(directory_, error.message());
  if (files_.empty()) return;
  std::sort(files_.begin(), files_.end(), By(&File::number));
  next_number_ = files_.back().number + 1;
  CutOffPartOfRecord();
  for (const File& file : files_) total_bytes_ += file.bytes;
}

void CaptureFiles::CutOffPartOfRecord() {
  File& file = files_.back();
  const Descriptor earlier(::open(file.path.c_str(), O_RDWR | O_CLOEXEC));
  if (!earlier.is_open()) FailToWrite(file.path);
  const std::uint64_t whole = WholeBytes(earlier.get(), file.bytes);
  if (whole == 0) return RemoveLast();
  if (whole == file.bytes) return;
  if (::ftruncate(earlier.get(), static_cast<off_t>(whole)) != 0) {
    FailToWrite(file.path);
  }
  file.bytes = whole;
}

void CaptureFiles::Write(std::string_view records) {
  struct stat status {};
  const bool is_removed = ::fstat(open_.get(), &status) == 0 && status.st_nlink == 0;
  if (is_removed) open_.Close();
  while (!records.empty()) {
    const std::uint64_t used = open_.is_open() ? files_.back().bytes : kCaptureHeaderBytes;
    std::size_t fitting = 0;
    std::uint64_t packets = 0;
    while (fitting < records.size()) {
      const std::size_t record = CaptureRecordBytes(records.substr(fitting));
      if (used + fitting + record > limits_.file_bytes) break;
      fitting += record;
      ++packets;
    }
    if (!open_.is_open() || fitting == 0) {
      OpenNext();
    } else {
      Append(records.substr(0, fitting), packets);
      records.remove_prefix(fitting);
    }
  }
}

void CaptureFiles::OpenNext() {
  open_.Close();
  MakeRoom(kCaptureHeaderBytes);
  const std::string path = directory_ + "/" + NameOf(next_number_);
  Descriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0666));
  if (!file.is_open()) FailToWrite(path);
  files_.push_back({next_number_++, path, 0});
  open_ = std::move(file);
  Append(CaptureHeader(), 0);
}

void CaptureFiles::Append(std::string_view records, std::uint64_t packets) {
  MakeRoom(records.size());
  File& file = files_.back();
  try {
    WriteAll(open_.get(), records, file.path);
  } catch (const OutputError&) {
    if (file.bytes == 0) {  // no header
      RemoveLast();
    } else if (::ftruncate(open_.get(), static_cast<off_t>(file.bytes)) != 0) {
      open_.Close();  // the next records go to another file
    }
    throw;
  }
  file.bytes += records.size();
  total_bytes_ += records.size();
  packets_ += packets;
}

void CaptureFiles::RemoveLast() {
  open_.Close();
  ::unlink(files_.back().path.c_str());
  files_.pop_back();
}

// The open file stays: two fit.
void CaptureFiles::MakeRoom(std::uint64_t bytes) {
  while (total_bytes_ + bytes > limits_.total_bytes && files_.size() > (open_.is_open() ? 1 : 0)) {
    const File& oldest = files_.front();
    if (::unlink(oldest.path.c_str()) != 0 && errno != ENOENT) {
      FailToWrite(oldest.path, std::string("cannot be removed: ") + std::strerror(errno));
    }
    total_bytes_ -= oldest.bytes;
    files_.pop_front();
  }
}

PacketRecorder::PacketRecorder(CaptureFiles& files, const LivoxEndpoint& receiver)
    : files_(files), receiver_(receiver), counts_{0, 0, files.total_bytes()}, thread_([this] {
        Run();
      }) {}

void PacketRecorder::Add(const Datagram& datagram) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (waiting_.size() >= kMaxWaitingBytes) {
    return LosePackets(1, "the disk is slower than the packets");
  }
  AppendCaptureRecord(datagram, receiver_, waiting_);
  ++waiting_packets_;
  if (waiting_.size() >= kMaxWriteBytes) is_due_.notify_one();
}

void PacketRecorder::Stop() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_ending_ = true;
  }
  is_due_.notify_one();
  thread_.join();
}

RecordingCounts PacketRecorder::counts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counts_;
}

std::optional<std::string> PacketRecorder::TakeFailure() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(failure_, std::nullopt);
}

void PacketRecorder::Run() {
  std::string records;
  std::unique_lock<std::mutex> lock(mutex_);
  for (bool is_last = false; !is_last;) {
    is_due_.wait_for(lock, kWriteInterval,
                     [this] { return is_ending_ || waiting_.size() >= kMaxWriteBytes; });
    is_last = is_ending_;
    records.clear();
    records.swap(waiting_);
    const std::uint64_t packets = std::exchange(waiting_packets_, 0);
    lock.unlock();
    std::string failure;
    const std::uint64_t before = files_.packets();
    try {
      files_.Write(records);
    } catch (const OutputError& error) {
      failure = error.what();
    }
    const std::uint64_t written = files_.packets() - before;
    lock.lock();
    counts_.packets += written;
    counts_.bytes = files_.total_bytes();
    if (failure.empty()) {
      is_failing_ = is_failing_ && packets == 0;
    } else {
      LosePackets(packets - written, failure);
    }
  }
}

// The mutex is held.
void PacketRecorder::LosePackets(std::uint64_t count, const std::string& reason) {
  counts_.lost_packets += count;
  if (!std::exchange(is_failing_, true)) failure_ = reason;
}

}  // namespace unlidar
