// Tests of what runs on several threads.
#pragma once

#include "base/parallel.hpp"

namespace unlidar::testing {

// So many threads may be used for as long as it lives.
class Threads {
 public:
  explicit Threads(int count) : before_(MaxThreads()) { MaxThreads() = count; }
  ~Threads() { MaxThreads() = before_; }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

 private:
  int before_;
};

}  // namespace unlidar::testing
