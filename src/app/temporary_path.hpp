// Files that must not be left behind.
#pragma once

#include <string>

namespace unlidar {

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

}  // namespace unlidar
