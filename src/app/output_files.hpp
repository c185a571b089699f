// Files that appear whole or not at all, and the lines that the program prints.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace unlidar {

// Takes the bytes of an output, one piece after the other.
using Sink = std::function<void(std::string_view)>;

// Hands all bytes of an output to a sink.
using ContentWriter = std::function<void(const Sink&)>;

struct OutputFile {
  std::string path;
  ContentWriter write;
};

ContentWriter Content(std::string bytes);

// The path with symbolic links (also those to nothing) and `.` and `..` resolved: what a write to
// it would replace. The path itself where that cannot be told.
std::string ResolvedPath(const std::string& path);

// True for a pipe or a device, such as /dev/null or /dev/stdout: written in place. Throws
// OutputError where the system does not tell.
bool IsSpecialFile(const std::string& path);

// Throws OutputError unless a file can be created beside the target; leaves nothing behind.
void CheckWritable(const std::string& path);

// Writes every file beside its target, then those that are special, then renames the first ones. A
// file that is replaced hands on its permissions and, where the system allows it, its owner.
//
// Throws OutputError if one of them cannot be written; then every regular file is as it was before.
// (Of several files, some may be new already if the system fails between two renames.) Nothing is
// left behind then, nor where a signal ends the process. Where it dies without warning, what it
// leaves is in no later run's way.
void WriteFiles(const std::vector<OutputFile>& files);

// A path of its own beside another one, whatever that one's name. A file that is there when the
// object dies is removed: moved elsewhere, it stays.
//
// It is removed as well where a signal ends the process (SIGHUP, SIGINT, SIGQUIT, SIGTERM,
// SIGXCPU), which then dies by that signal as it would have anyway. A signal that is ignored or
// handled when the first of these objects is made keeps its meaning. For one thread at a time.
class TemporaryPath {
 public:
  explicit TemporaryPath(const std::string& beside);
  ~TemporaryPath();
  TemporaryPath(const TemporaryPath&) = delete;
  TemporaryPath& operator=(const TemporaryPath&) = delete;

  const char* c_str() const { return path_.c_str(); }

  // The files of all of them. May be called by a signal handler.
  static void RemoveAll();

 private:
  std::string path_;
  TemporaryPath* next_ = nullptr;
};

// Takes a line about what happens, without the newline.
using NoteCallback = std::function<void(const std::string&)>;

// Throws the OutputError of a file that cannot be written; without `reason`, that of errno.
[[noreturn]] void FailToWrite(const std::string& path, const std::string& reason);
[[noreturn]] void FailToWrite(const std::string& path);

// Writes all bytes, or throws OutputError with `path` in its text.
void WriteAll(int fd, std::string_view bytes, const std::string& path);

// Throws OutputError.
void WriteToStdout(std::string_view text);

// Ignores errors: there is nowhere left to report them.
void WriteToStderr(std::string_view text);

// A line on stdout, not endless. Throws OutputError.
void PrintResult(const std::string& text);

// A line on stderr behind the name of the program, not endless.
void PrintNote(const std::string& text);

}  // namespace unlidar
