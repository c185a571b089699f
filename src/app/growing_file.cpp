#include "app/growing_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <utility>

#include "base/format.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kReaderPollInterval(100);
// Time granted to a reader that takes nothing before the program ends without it.
constexpr milliseconds kReaderTimeout(1000);

ssize_t WriteOnce(int fd, std::string_view bytes) {
  return Uninterrupted([&] { return ::write(fd, bytes.data(), bytes.size()); });
}

}  // namespace

GrowingFile::GrowingFile(std::string path, Format format, Signals& signals, NoteCallback note,
                         LineCallback on_line)
    : path_(std::move(path)),
      name_(path_ == "-" ? "stdout" : path_),
      format_(std::move(format)),
      signals_(signals),
      note_(std::move(note)),
      on_line_(std::move(on_line)) {
  Open();
  if (!is_regular_) {
    WriteSpecial();
  } else if (!WriteRegular()) {
    FailToWrite(name_, std::strerror(ENOSPC));
  }
}

void GrowingFile::Flush() {
  if (!is_regular_) {
    if (!waiting_.empty()) WriteSpecial();
    return;
  }
  const bool was_full = std::exchange(is_full_, !WriteRegular());
  if (is_full_) DropOldest();
  if (is_full_ == was_full) return;
  note_(is_full_ ? path_ + ": the disk is full, rows wait in memory until there is room"
                 : path_ + ": there is room again" +
                       (lost_lines_ > 0 ? ", lost: " + Count(lost_lines_, "line") : ""));
}

bool GrowingFile::Reopen() {
  if (path_ == "-") return false;
  struct stat before {};
  struct stat now {};
  const bool is_same = ::fstat(fd_.get(), &before) == 0 && ::stat(path_.c_str(), &now) == 0 &&
                       before.st_dev == now.st_dev && before.st_ino == now.st_ino;
  if (is_same) return false;
  fd_.Close();
  Open();
  Flush();
  return true;
}

void GrowingFile::Close() {
  Flush();
  if (is_full_) {
    const auto lines = std::count(waiting_.begin(), waiting_.end(), '\n');
    FailToWrite(name_, std::string(std::strerror(ENOSPC)) + ", lost: " +
                           Count(lost_lines_ + static_cast<std::uint64_t>(lines), "line"));
  }
}

void GrowingFile::Open() {
  fd_ = Descriptor(OpenPath());
  struct stat status {};
  if (::fstat(fd_.get(), &status) != 0) FailToWrite(name_);
  if (S_ISDIR(status.st_mode)) FailToWrite(name_, "it is a directory, expected a file");
  // stdout belongs to the caller: it is only written to, even if it is a file.
  is_regular_ = S_ISREG(status.st_mode) && path_ != "-";
  if (!is_regular_) {
    waiting_.insert(0, format_.header);
    return;
  }
  if (::flock(fd_.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    FailToWrite(name_, "another process is writing it, expected a file of its own");
  }
  ReadLines();
}

int GrowingFile::OpenPath() const {
  if (path_ == "-") {
    const int fd = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0);
    if (fd < 0) FailToWrite(name_);
    return fd;
  }
  if (IsSpecialFile(path_)) return OpenPipe();
  const int fd = ::open(path_.c_str(), O_RDWR | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  if (fd < 0) FailToWrite(name_);
  return fd;
}

// A pipe without a reader cannot be opened: waits for one.
int GrowingFile::OpenPipe() const {
  while (true) {
    const int fd = ::open(path_.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd >= 0) {
      ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) & ~O_NONBLOCK);
      return fd;
    }
    if (errno != ENXIO) FailToWrite(name_);
    if (signals_.ShouldEnd()) FailToWrite(name_, "it has no reader");
    signals_.Wait({}, kReaderPollInterval);
  }
}

// Hands out the lines that are there and cuts off what follows the last of them.
void GrowingFile::ReadLines() {
  std::array<char, 1 << 16> block{};
  std::string line;
  std::uint64_t number = 0;
  off_t whole = 0;  // bytes of whole lines
  while (true) {
    const off_t at = whole + static_cast<off_t>(line.size());
    const ssize_t got =
        Uninterrupted([&] { return ::pread(fd_.get(), block.data(), block.size(), at); });
    if (got < 0) FailToWrite(name_);
    if (got == 0) break;
    std::string_view rest(block.data(), static_cast<std::size_t>(got));
    const std::string_view first = rest.substr(0, format_.first_text.size());
    if (whole == 0 && line.empty() && first != format_.first_text.substr(0, first.size())) {
      FailToWrite(name_, "it holds something else, expected a new file or one that begins with '" +
                             format_.first_text.substr(0, format_.first_text.find('\n')) + "'");
    }
    for (std::size_t end = rest.find('\n'); end != std::string_view::npos; end = rest.find('\n')) {
      line.append(rest.substr(0, end + 1));
      rest.remove_prefix(end + 1);
      whole += static_cast<off_t>(line.size());
      if (++number > 1 || format_.header.empty()) {
        line.pop_back();
        if (on_line_) on_line_(line, number);
      }
      line.clear();
    }
    line.append(rest);
    if (line.size() > format_.max_line_bytes)
      FailToWrite(name_, "it has a line that is none of this output");
  }
  if (line.empty()) return;
  note_(path_ + ": its last line was not finished and is cut off");
  if (::ftruncate(fd_.get(), whole) != 0) FailToWrite(name_);
}

// False if the disk is full: then the file is as it was.
bool GrowingFile::WriteRegular() {
  struct stat status {};
  if (::fstat(fd_.get(), &status) != 0) FailToWrite(name_);
  // A file may have been emptied meanwhile.
  const std::string text = (status.st_size == 0 ? format_.header : "") + waiting_;
  std::string_view rest = text;
  while (!rest.empty()) {
    const ssize_t written = WriteOnce(fd_.get(), rest);
    if (written < 0) {
      const int error = errno;
      if (rest.size() < text.size() && ::ftruncate(fd_.get(), status.st_size) != 0)
        FailToWrite(name_);
      if (error != ENOSPC && error != EDQUOT) FailToWrite(name_, std::strerror(error));
      return false;
    }
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
  waiting_.clear();
  return true;
}

// Writes pieces that a pipe with room for anything takes at once, so that a signal is seen while
// its reader sleeps.
void GrowingFile::WriteSpecial() {
  std::string_view rest = waiting_;
  while (!rest.empty()) {
    const bool ends = signals_.ShouldEnd();
    const auto ready =
        signals_.Wait({{fd_.get(), POLLOUT, 0}}, ends ? kReaderTimeout : milliseconds(-1));
    if (ready.front().revents == 0) {
      if (ends) FailToWrite(name_, "its reader takes nothing");
      continue;
    }
    const ssize_t written = WriteOnce(fd_.get(), rest.substr(0, PIPE_BUF));
    if (written < 0 && errno == EAGAIN) continue;
    if (written < 0) FailToWrite(name_);
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
  waiting_.clear();
}

void GrowingFile::DropOldest() {
  if (waiting_.size() <= kMaxWaitingBytes) return;
  const std::size_t end = waiting_.find('\n', waiting_.size() - kMaxWaitingBytes);
  const auto kept = waiting_.begin() + static_cast<std::ptrdiff_t>(end + 1);
  lost_lines_ += static_cast<std::uint64_t>(std::count(waiting_.begin(), kept, '\n'));
  waiting_.erase(waiting_.begin(), kept);
}

NewestLines::NewestLines(const std::string& path, NoteCallback note)
    : path_(ResolvedPath(path)), note_(std::move(note)) {
  BeginAnew();
}

void NewestLines::Append(std::string_view line) {
  try {
    if (!file_.is_open() || bytes_ + line.size() > kMaxBytes) BeginAnew();
    bytes_ += line.size();
    WriteAll(file_.get(), line, path_);
    has_failed_ = false;
  } catch (const OutputError& error) {
    file_.Close();  // its last line may be torn
    if (!std::exchange(has_failed_, true)) note_(error.what());
  }
}

void NewestLines::BeginAnew() {
  const TemporaryPath temporary(path_);
  Descriptor file(Uninterrupted(
      [&] { return ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666); }));
  if (!file.is_open() || std::rename(temporary.c_str(), path_.c_str()) != 0) {
    FailToWrite(path_);
  }
  file_ = std::move(file);
  bytes_ = 0;
}

}  // namespace unlidar
