// Signals of a program that runs for weeks, taken where it waits and nowhere else.
#pragma once

#include <poll.h>

#include <chrono>
#include <vector>

namespace unlidar {

// From its making on and for the rest of the process, SIGTERM, SIGINT and SIGHUP wait until they
// are looked for: none comes at a bad moment, none is lost. A reader that has left, a file that
// grows too large and a lease that breaks no longer end the process but fail the calls they meet.
class Signals {
 public:
  Signals();
  ~Signals();
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  // Waits until one of `fds` is ready, a signal has come or the time is over. Returns `fds` with
  // their revents.
  std::vector<pollfd> Wait(std::vector<pollfd> fds, std::chrono::milliseconds timeout);

  // True for ever once SIGTERM or SIGINT has come.
  bool ShouldEnd();

  // True once for any number of SIGHUP since the last call.
  bool ShouldReopen();

 private:
  void Take();

  int fd_ = -1;
  bool ends_ = false;
  bool reopens_ = false;
};

}  // namespace unlidar
