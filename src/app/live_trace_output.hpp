// --trace of a live run: the lines of trace_lines.hpp, written as they come.
#pragma once

#include <string>

#include "app/growing_file.hpp"
#include "app/output_files.hpp"
#include "app/signals.hpp"
#include "live/live_trace.hpp"

namespace unlidar {

// Appends to what an earlier run left; each run, and each file that takes the place of one that was
// moved away, begins with a header. Nothing is held back but what a full disk does not take.
class LiveTraceOutput {
 public:
  // Throws OutputError, as all of them do.
  LiveTraceOutput(const std::string& path, Signals& signals, const NoteCallback& note);

  // Writes each event; must not outlive this.
  LiveTraceSink Sink();

  void Reopen();
  void Close() { file_.Close(); }
  int reader_fd() const { return file_.reader_fd(); }

 private:
  void Add(const TracedFrame& traced);
  void Add(const TracedPath& traced);
  void Add(const TracedTrack& traced);
  void AddHeader();

  GrowingFile file_;
};

}  // namespace unlidar
