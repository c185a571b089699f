// The newest lines of a stream, for a reader beside the program.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "app/output_files.hpp"
#include "io/descriptor.hpp"

namespace unlidar {

// A file that its reader follows as it grows. Before it exceeds kMaxBytes a new one takes its
// place; nothing else is kept. Lines that cannot be written are lost, which is noted once until it
// goes well again.
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
