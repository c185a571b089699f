// --trace: measurements of a search and its reasons for rejecting paths, as JSON lines.
//
// One line is an object whose `trace` says of what: `header`, the sensors; `frame`, its detections
// with their clutter terms; `path`, its score, the threshold and the rule that refused it; `track`,
// in streams, its state. docs/explain.md lists the members.
#pragma once

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "app/growing_file.hpp"
#include "app/output_files.hpp"
#include "app/service.hpp"
#include "live/live_trace.hpp"
#include "recording/robust.hpp"

namespace unlidar {

// Takes the searches of a recording in, window by window, and gives the bytes of the file: a frame
// once, however many windows it is in. They are kept in a temporary file without a name: a long
// recording has more of them than fit into memory.
class TraceOutput {
 public:
  // Throws OutputError where there is no room for the file, as Add does.
  TraceOutput();

  void Add(const Recording& recording, const SearchTrace& trace);

  // Writes the trace, once all is added. Throws OutputError where it cannot be read back.
  void Write(const Sink& sink) const;

 private:
  void Append(const std::string& line);

  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::vector<TimeNs> written_until_ns_;  // (sensors) stamps; empty before the header
};

// --trace of a live run, written as it comes. Appends to what an earlier run left; each run, and
// each file that takes the place of one that was moved away, begins with a header. Nothing is held
// back but what a full disk does not take.
class LiveTraceOutput {
 public:
  // Throws OutputError, as all of them do.
  LiveTraceOutput(const std::string& path, Signals& signals, const NoteCallback& note);

  // Writes each event; must not outlive this.
  LiveTraceSink Sink();

  void Reopen() {
    if (file_.Reopen()) AddHeader();
  }
  void Close() { file_.Close(); }
  int reader_fd() const { return file_.reader_fd(); }

 private:
  void AddHeader();

  GrowingFile file_;
};

}  // namespace unlidar
