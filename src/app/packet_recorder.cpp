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
#include <utility>

#include "app/output_files.hpp"
#include "base/format.hpp"
#include "io/packet_capture.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPrefix = "packets_";
constexpr std::string_view kTimeShape = "_00000000T000000Z.pcap";  // 0: any digit
constexpr std::size_t kMinDigits = 8;
constexpr std::size_t kMaxDigits = 15;

constexpr std::chrono::seconds kWriteInterval(1);

// Returns the number in a name that NameOf() gives; files with other names are somebody else's.
std::optional<std::uint64_t> NumberOf(std::string_view name) {
  const std::size_t least = kPrefix.size() + kMinDigits + kTimeShape.size();
  if (name.size() < least || name.substr(0, kPrefix.size()) != kPrefix) return std::nullopt;
  const std::string_view time = name.substr(name.size() - kTimeShape.size());
  const auto has_shape = [](char c, char shape) { return shape == '0' ? IsDigit(c) : c == shape; };
  if (!std::equal(time.begin(), time.end(), kTimeShape.begin(), has_shape)) return std::nullopt;
  const std::string_view digits =
      name.substr(kPrefix.size(), name.size() - kPrefix.size() - kTimeShape.size());
  if (digits.size() > kMaxDigits) return std::nullopt;
  return ParseNumber<std::uint64_t>(digits);
}

// The time is for people: the numbers are in order whatever the clock does.
std::string NameOf(std::uint64_t number) {
  std::string digits = std::to_string(number);
  digits.insert(0, kMinDigits - std::min(kMinDigits, digits.size()), '0');
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 32> time{};
  std::strftime(time.data(), time.size(), "_%Y%m%dT%H%M%SZ.pcap", &utc);
  return std::string(kPrefix) + digits + time.data();
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
  std::sort(files_.begin(), files_.end(),
            [](const File& a, const File& b) { return a.number < b.number; });
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
