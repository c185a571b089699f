// --trace: measurements of a search and its reasons for rejecting paths, as JSON lines.
#pragma once

#include <cstdio>
#include <memory>
#include <vector>

#include "app/output_files.hpp"
#include "recording/trace.hpp"

namespace unlidar {

// Takes the searches of a recording in, window by window, and gives the bytes of the file. They are
// kept in a temporary file without a name: a long recording has more of them than fit into memory.
//
// One line is an object whose `trace` says of what: `header`, the sensors; `frame`, its detections
// with their clutter terms, once however many windows it is in; `path`, its score, the threshold
// and the rule that refused it. docs/explain.md lists the members.
class TraceOutput {
 public:
  // Throws OutputError where there is no room for the file, as Add does.
  TraceOutput();

  void Add(const Recording& recording, const SearchTrace& trace);

  // Writes the trace, to be called when all is added. Throws OutputError where it cannot be read
  // back.
  void Write(const Sink& sink) const;

 private:
  void Append(const std::string& line);
  void AddFrames(const Recording& recording, const SearchTrace& trace);
  void AddPaths(const SearchTrace& trace);

  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  bool has_header_ = false;
  std::vector<TimeNs> written_until_ns_;  // (sensors) stamps
};

}  // namespace unlidar
