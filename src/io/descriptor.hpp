// What reading and writing files share.
#pragma once

#include <unistd.h>

#include <cerrno>
#include <utility>

namespace unlidar {

// The result of a system call, repeated while a signal interrupts it.
template <class Call>
auto Uninterrupted(const Call& call) {
  while (true) {
    const auto result = call();
    if (result >= 0 || errno != EINTR) return result;
  }
}

// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { Close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int get() const { return fd_; }

  // False, with errno, where the system could not keep what was written. Closes once only, also
  // where a signal interrupts it: Linux has closed the file by then.
  bool Close() {
    const int fd = std::exchange(fd_, -1);
    return fd < 0 || ::close(fd) == 0 || errno == EINTR;
  }

 private:
  int fd_;
};

}  // namespace unlidar
