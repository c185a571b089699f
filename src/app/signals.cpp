#include "app/signals.hpp"

#include <sys/signalfd.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

namespace unlidar {

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

}  // namespace unlidar
