#include "base/memory_reserve.hpp"

namespace unlidar {

thread_local MemoryReserve* MemoryReserve::current = nullptr;

// Default-initialised: pages that are never written take no memory.
MemoryReserve::MemoryReserve(std::size_t bytes)
    : memory_(new char[bytes]), previous_(std::set_new_handler(&Free)) {
  current = this;
}

MemoryReserve::~MemoryReserve() {
  current = nullptr;
  std::set_new_handler(previous_);
}

void MemoryReserve::Free() {
  if (current == nullptr || current->memory_ == nullptr) throw std::bad_alloc();
  current->memory_.reset();
}

}  // namespace unlidar
