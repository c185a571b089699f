// Memory reserve for code that cannot handle an allocation failure.
#pragma once

#include <cstddef>
#include <memory>
#include <new>

namespace unlidar {

// During its lifetime, the first failing operator new on its thread frees the reserve and is
// retried. The owner checks was_needed() afterwards and then fails in an orderly way. At most one
// instance per thread at a time.
class MemoryReserve {
 public:
  // Throws std::bad_alloc if `bytes` are not available.
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
