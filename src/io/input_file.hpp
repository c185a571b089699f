// Bounded reading of files; every failure is an InputError that names the file.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/descriptor.hpp"

namespace unlidar {

// Expected kind of a file. Pipes and devices are read if the user names them in an option; in a
// directory they are rejected, since a pipe may never have a writer.
struct InputKind {
  std::string expected;  // for messages, such as "a PCD file"
  bool must_be_regular = false;
};

class InputFile {
 public:
  // Throws InputError if the file cannot be opened or is of another kind.
  InputFile(const std::string& path, const InputKind& kind);

  // Size of a regular file in bytes; 0 for other files.
  std::uint64_t size() const { return size_; }

  // Reads `count` bytes, or fewer at the end of the file; returns their number. Throws InputError.
  std::size_t Read(char* to, std::size_t count);

 private:
  [[noreturn]] void FailToRead(const std::string& reason) const;

  std::string path_;
  std::string expected_;
  Descriptor file_;
  std::uint64_t size_ = 0;
};

// Returns all bytes of a file. Throws InputError, also for more than max_bytes.
std::string ReadWhole(const std::string& path, const InputKind& kind, std::size_t max_bytes);

// Separators of values in a line; Windows lines end with a carriage return.
inline constexpr std::string_view kBlanks = " \t\r";

// Returns the text without leading and trailing blanks.
std::string_view Trimmed(std::string_view text);

// Returns the values of a line, between blanks.
std::vector<std::string_view> ValuesOf(std::string_view line);

// Reads a file of any length line by line, in bounded memory.
class LineReader {
 public:
  LineReader(const std::string& path, const InputKind& kind);

  // Advances to the next line; returns false if there is none. Throws InputError, also for a line
  // of more than 64 KiB, more than 10 million lines or 1 GiB, which only endless input exceeds.
  bool Next();

  // Line without its line feed; valid until the next call of Next().
  std::string_view line() const { return line_; }

  // Number of the line, from 1; 0 before the first.
  std::size_t number() const { return number_; }

 private:
  std::string path_;
  InputFile file_;
  std::vector<char> buffer_;
  std::string_view unread_;  // part of the buffer
  std::uint64_t bytes_read_ = 0;
  std::string_view line_;
  std::size_t number_ = 0;
};

}  // namespace unlidar
