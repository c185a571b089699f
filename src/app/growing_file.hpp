// Outputs that grow line by line for weeks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "app/output_files.hpp"
#include "app/service.hpp"
#include "io/descriptor.hpp"

namespace unlidar {

// Lines are appended to what an earlier run left; a line that it could not finish is cut off. Each
// Flush() is one write of whole lines. A pipe or a device is written as its reader takes it.
//
// Where the disk is full, lines wait in memory and the file stays as it is, without a torn line;
// the next Flush() tries again. Beyond kMaxWaitingBytes the oldest lines are lost and counted.
//
// Throws OutputError for a file that is not its own (another first line, another process that
// writes it) and for each error but a full disk.
class GrowingFile {
 public:
  static constexpr std::size_t kMaxWaitingBytes = std::size_t{1} << 22;

  using LineCallback = std::function<void(std::string_view line, std::uint64_t number)>;

  struct Format {
    std::string header;      // first line of a new file, with its newline; may be empty
    std::string first_text;  // what every file of this kind begins with
    std::size_t max_line_bytes = std::size_t{1} << 16;  // far longer than any line of it
  };

  // `path`: `-` is stdout. `on_line` gets each line that is there but the header, with its number,
  // here and in Reopen().
  GrowingFile(std::string path, Format format, Signals& signals, NoteCallback note,
              LineCallback on_line = nullptr);

  // Whole lines, for the next Flush().
  void Append(std::string_view lines) { waiting_ += lines; }

  void Flush();

  // Reopens the path: a new file if the old one was moved away. Returns true if new.
  bool Reopen();

  // The last Flush(). Throws OutputError if the disk is still full.
  void Close();

  // Descriptor by which a poll learns that its reader has left; -1 for a regular file.
  int reader_fd() const { return is_regular_ ? -1 : fd_.get(); }

 private:
  void Open();
  int OpenPath() const;
  int OpenPipe() const;
  void ReadLines();
  bool WriteRegular();
  void WriteSpecial();
  void DropOldest();

  std::string path_;
  std::string name_;  // for messages
  Format format_;
  Signals& signals_;
  NoteCallback note_;
  LineCallback on_line_;
  Descriptor fd_;
  bool is_regular_ = false;
  bool is_full_ = false;  // the disk
  std::string waiting_;
  std::uint64_t lost_lines_ = 0;
};

// A file that its reader follows as it grows. Before it exceeds kMaxBytes a new one takes its
// place. Lines that cannot be written are lost, which is noted once until it goes well again.
class NewestLines {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 20;

  // Throws OutputError if the file cannot be made.
  NewestLines(const std::string& path, NoteCallback note);

  // Writes a line, given with its newline.
  void Append(std::string_view line);

 private:
  void BeginAnew();

  std::string path_;  // without links, which would be replaced
  NoteCallback note_;
  Descriptor file_;  // closed where the last write failed
  std::size_t bytes_ = 0;
  bool has_failed_ = false;
};

}  // namespace unlidar
