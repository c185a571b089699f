// Memory for code that does not survive a failing allocation.
#pragma once

#include <cstddef>
#include <memory>
#include <new>

namespace unlidar {

// While it lives, the first allocation by operator new that fails on its thread frees the reserve
// and is tried again. Whoever made the reserve asks in the end whether that happened, and then
// fails in order. At most one at a time on a thread.
class MemoryReserve {
 public:
  // Throws std::bad_alloc if there is not so much memory now.
  explicit MemoryReserve(std::size_t bytes);
  MemoryReserve(const MemoryReserve&) = delete;
  MemoryReserve& operator=(const MemoryReserve&) = delete;
  ~MemoryReserve();

  bool was_needed() const { return memory_ == nullptr; }

 private:
  static void Free();  // the new handler

  static thread_local MemoryReserve* current;

  std::unique_ptr<char[]> memory_;
  std::new_handler previous_;
};

}  // namespace unlidar
