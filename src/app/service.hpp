// What a program that runs for weeks hears and tells of itself: signals, taken where it waits and
// nowhere else, and notifications to systemd.
#pragma once

#include <poll.h>

#include <chrono>
#include <optional>
#include <string>
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

// The protocol of sd_notify(3) (Type=notify, WatchdogSec), implemented here because libsystemd and
// the four libraries behind it cost a millisecond of start-up time, in every run, and 3.6 MB where
// nothing else needs them.
//
// Speaks to $NOTIFY_SOCKET; says nothing where there is none, as in a shell. Never waits and never
// fails: what could not be sent of SendHeartbeat() is sent by a later one.
class ServiceNotifier {
 public:
  ServiceNotifier();

  // To be called in each turn of the loop that does the work. The first call says that the service
  // has started. Later ones feed the watchdog, four times in $WATCHDOG_USEC and not more often.
  void SendHeartbeat();

  // A line for people, in `systemctl status`.
  void ReportStatus(const std::string& status) const { Send("STATUS=" + status); }

  // The service is about to end, by itself or by a signal.
  void ReportStopping() const { Send("STOPPING=1"); }

 private:
  using Clock = std::chrono::steady_clock;

  bool Send(const std::string& message) const;

  std::string address_;  // as in sockaddr_un::sun_path, empty for none
  Descriptor socket_;
  std::optional<Clock::duration> feeding_;  // from one feeding to the next
  bool has_started_ = false;
  Clock::time_point fed_;
};

}  // namespace unlidar
