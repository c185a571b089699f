// The one way to read a file: bounded, and whatever goes wrong is an InputError that names it.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/descriptor.hpp"

namespace unlidar {

// What is said and asked of a file. Who names a pipe or a device by an option gets it read; where a
// directory holds one, nobody may ever write to it.
struct InputKind {
  std::string expected;  // what messages expect the file to be, such as "a PCD file"
  bool must_be_regular = false;
};

// A file that is read front to back.
class InputFile {
 public:
  // Throws InputError for one that cannot be opened or is of another kind.
  InputFile(const std::string& path, const InputKind& kind);

  // Bytes of a regular file; those of others are not known.
  std::uint64_t size() const { return size_; }

  // Fills `to` as far as the file reaches; returns how far. Throws InputError.
  std::size_t Read(char* to, std::size_t count);

 private:
  [[noreturn]] void FailToRead(const std::string& reason) const;

  std::string path_;
  std::string expected_;
  Descriptor file_;
  std::uint64_t size_ = 0;
};

// All of a file's bytes. Throws InputError, also for more than max_bytes.
std::string ReadWhole(const std::string& path, const InputKind& kind, std::size_t max_bytes);

// What separates values in a line; lines of Windows end with a carriage return.
inline constexpr std::string_view kBlanks = " \t\r";

// Without the blanks at both ends.
std::string_view Trimmed(std::string_view text);

// The lines of a file, however long it is, in bounded memory.
class LineReader {
 public:
  LineReader(const std::string& path, const InputKind& kind);

  // Moves on to the next line, if there is one. Throws InputError, also for a line of more than
  // 64 KiB, more than 10 million lines or 1 GiB: no input has them but an endless one.
  bool Next();

  // Without its line feed; until the next call.
  std::string_view line() const { return line_; }

  // Of the line, from 1; 0 before the first.
  std::size_t number() const { return number_; }

 private:
  void Refill();

  std::string path_;
  InputFile file_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0;  // the unread part of the buffer
  std::size_t end_ = 0;
  std::uint64_t bytes_read_ = 0;
  bool at_end_ = false;
  std::string_view line_;
  std::size_t number_ = 0;
};

}  // namespace unlidar
