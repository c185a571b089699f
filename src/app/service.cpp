#include "app/service.hpp"

#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "base/format.hpp"

namespace unlidar {
namespace {

constexpr int kFeedings = 4;  // so that one that comes late is no death

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

// A path, or a name of the abstract namespace with '@' for the NUL before it. Empty where it is
// neither or does not fit.
std::string SocketAddress(std::string name) {
  if (name.size() < 2 || name.size() >= sizeof(sockaddr_un::sun_path)) return {};
  if (name.front() == '@') name.front() = '\0';
  return name.front() == '/' || name.front() == '\0' ? name : std::string();
}

std::optional<std::chrono::microseconds> WatchdogTime() {
  const std::string pid = Variable("WATCHDOG_PID");
  if (!pid.empty() && pid != std::to_string(::getpid())) return std::nullopt;
  const std::int64_t time_us = ParseNumber<std::int64_t>(Variable("WATCHDOG_USEC")).value_or(0);
  return time_us > 0 ? std::make_optional(std::chrono::microseconds(time_us)) : std::nullopt;
}

}  // namespace

Signals::Signals() {
  for (const int ignored : {SIGPIPE, SIGXFSZ, SIGIO}) std::signal(ignored, SIG_IGN);
  sigset_t waiting;
  sigemptyset(&waiting);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&waiting, signal);
  if (::sigprocmask(SIG_BLOCK, &waiting, nullptr) == 0) {
    fd_ = Descriptor(::signalfd(-1, &waiting, SFD_NONBLOCK | SFD_CLOEXEC));
  }
  if (!fd_.is_open()) throw std::runtime_error(std::string("signalfd: ") + std::strerror(errno));
}

std::vector<pollfd> Signals::Wait(std::vector<pollfd> fds, std::chrono::milliseconds timeout) {
  fds.push_back({fd_.get(), POLLIN, 0});
  if (::poll(fds.data(), fds.size(), static_cast<int>(timeout.count())) < 0) {
    if (errno != EINTR) throw std::runtime_error(std::string("poll: ") + std::strerror(errno));
    for (pollfd& fd : fds) fd.revents = 0;
  }
  fds.pop_back();
  return fds;
}

bool Signals::ShouldEnd() {
  Take();
  return ends_;
}

bool Signals::ShouldReopen() {
  Take();
  return std::exchange(reopens_, false);
}

void Signals::Take() {
  signalfd_siginfo info{};
  while (::read(fd_.get(), &info, sizeof(info)) == sizeof(info)) {
    if (info.ssi_signo == SIGHUP) {
      reopens_ = true;
    } else {
      ends_ = true;
    }
  }
}

ServiceNotifier::ServiceNotifier()
    : address_(SocketAddress(Variable("NOTIFY_SOCKET"))),
      socket_(address_.empty() ? -1 : ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)),
      fed_(Clock::now()) {
  if (const auto time = WatchdogTime()) feeding_ = Clock::duration(*time) / kFeedings;
}

void ServiceNotifier::SendHeartbeat() {
  if (!has_started_) has_started_ = Send("READY=1");
  const Clock::time_point now = Clock::now();
  if (feeding_ && now - fed_ >= *feeding_ && Send("WATCHDOG=1")) fed_ = now;
}

bool ServiceNotifier::Send(const std::string& message) const {
  if (!socket_.is_open()) return false;
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::copy(address_.begin(), address_.end(), to.sun_path);
  // The length says where an abstract name ends.
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  const ssize_t sent =
      ::sendto(socket_.get(), message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
               reinterpret_cast<const sockaddr*>(&to), length);
  return sent >= 0;
}

}  // namespace unlidar
