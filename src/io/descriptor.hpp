// File descriptor and system calls shared by the readers and writers of files.
#pragma once

#include <unistd.h>

#include <cerrno>
#include <utility>

namespace unlidar {

// Returns the result of a system call, repeated while a signal interrupts it.
template <class Call>
auto Uninterrupted(const Call& call) {
  while (true) {
    const auto result = call();
    if (result >= 0 || errno != EINTR) return result;
  }
}

// File descriptor that is closed on destruction.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  ~Descriptor() { Close(); }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }

  bool is_open() const { return fd_ >= 0; }
  int get() const { return fd_; }

  // Returns false, with errno set, if the system could not store the written data. Closes only
  // once, even if a signal interrupts it: Linux has closed the file by then.
  bool Close() {
    const int fd = std::exchange(fd_, -1);
    return fd < 0 || ::close(fd) == 0 || errno == EINTR;
  }

 private:
  int fd_;
};

}  // namespace unlidar
