// Signals of a program that runs for weeks, taken where it waits and nowhere else.
#pragma once

#include <poll.h>

#include <chrono>
#include <vector>

#include "io/descriptor.hpp"

namespace unlidar {

// From construction to the end of the process, SIGTERM, SIGINT and SIGHUP are blocked until polled:
// none interrupts other work, none is lost. A reader that has left, a file that grows too large and
// a broken lease no longer end the process but make the affected calls fail.
class Signals {
 public:
  Signals();
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

  Descriptor fd_;
  bool ends_ = false;
  bool reopens_ = false;
};

}  // namespace unlidar
