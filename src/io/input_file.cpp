#include "io/input_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstring>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::size_t kMaxLineBytes = std::size_t{1} << 16;
constexpr std::size_t kMaxLines = 10'000'000;
constexpr std::uint64_t kMaxBytesInLines = std::uint64_t{1} << 30;

[[noreturn]] void FailAsTooLong(const std::string& path, std::uint64_t most,
                                const std::string& unit) {
  throw InputError(path + ": more than " + std::to_string(most) + " " + unit + ", expected fewer");
}

}  // namespace

InputFile::InputFile(const std::string& path, const InputKind& kind)
    : path_(path), expected_(kind.expected), file_(Uninterrupted([&] {
        // Opening a pipe blocks until it has a writer.
        return ::open(path.c_str(), O_RDONLY | O_CLOEXEC | (kind.must_be_regular ? O_NONBLOCK : 0));
      })) {
  if (!file_.is_open()) FailToRead(std::strerror(errno));
  struct stat status {};
  if (::fstat(file_.get(), &status) != 0) FailToRead(std::strerror(errno));
  if (S_ISREG(status.st_mode)) {
    size_ = static_cast<std::uint64_t>(status.st_size);
  } else if (kind.must_be_regular) {
    FailToRead("not a regular file");
  }
}

std::size_t InputFile::Read(char* to, std::size_t count) {
  std::size_t filled = 0;
  while (filled < count) {
    const ssize_t got =
        Uninterrupted([&] { return ::read(file_.get(), to + filled, count - filled); });
    if (got < 0) FailToRead(std::strerror(errno));
    if (got == 0) break;
    filled += static_cast<std::size_t>(got);
  }
  return filled;
}

void InputFile::FailToRead(const std::string& reason) const {
  throw InputError(path_ + ": cannot be read (" + reason + "), expected " + expected_);
}

std::string ReadWhole(const std::string& path, const InputKind& kind, std::size_t max_bytes) {
  InputFile file(path, kind);
  std::string text(max_bytes + 1, '\0');
  text.resize(file.Read(text.data(), text.size()));
  if (text.size() > max_bytes) FailAsTooLong(path, max_bytes, "bytes");
  return text;
}

std::string_view Trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

std::vector<std::string_view> ValuesOf(std::string_view line) {
  std::vector<std::string_view> values;
  std::size_t begin = line.find_first_not_of(kBlanks);
  while (begin != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(kBlanks, begin), line.size());
    values.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kBlanks, end);
  }
  return values;
}

LineReader::LineReader(const std::string& path, const InputKind& kind)
    : path_(path), file_(path, kind), buffer_(kMaxLineBytes + 1) {}

bool LineReader::Next() {
  std::size_t feed = unread_.find('\n');
  if (feed == std::string_view::npos) {
    // Moves the unread part to the front and reads after it.
    char* const to = std::copy(unread_.begin(), unread_.end(), buffer_.data());
    const std::size_t got = file_.Read(to, buffer_.size() - unread_.size());
    unread_ = {buffer_.data(), unread_.size() + got};
    bytes_read_ += got;
    if (bytes_read_ > kMaxBytesInLines) FailAsTooLong(path_, kMaxBytesInLines, "bytes");
    feed = unread_.find('\n');
    if (feed == std::string_view::npos && unread_.size() == buffer_.size()) {
      FailAsTooLong(path_ + ":" + std::to_string(number_ + 1), kMaxLineBytes, "bytes in a line");
    }
  }
  if (unread_.empty()) return false;
  if (++number_ > kMaxLines) FailAsTooLong(path_, kMaxLines, "lines");
  line_ = unread_.substr(0, feed);
  unread_.remove_prefix(std::min(line_.size() + 1, unread_.size()));
  return true;
}

}  // namespace unlidar
