// Parallel loop over independent work items.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <system_error>
#include <thread>
#include <vector>

namespace unlidar {

// Maximum number of threads of the process, 1 by default. Results never depend on it.
inline std::atomic<int>& MaxThreads() {
  static std::atomic<int> threads{1};
  return threads;
}

// Calls work(i) once for each i below `count`, in any order, on up to MaxThreads() threads
// including the caller's; on fewer if the system provides no more. `work` must not access data that
// another call writes. After all calls have ended, rethrows the exception of the lowest i.
template <class Work>
void ParallelFor(std::size_t count, const Work& work) {
  std::vector<std::exception_ptr> errors(count);
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        errors[i] = std::current_exception();
      }
    }
  };
  const auto max_threads = static_cast<std::size_t>(std::max(1, MaxThreads().load()));
  std::vector<std::thread> workers;
  workers.reserve(std::min(max_threads, count));
  try {
    while (workers.size() + 1 < std::min(max_threads, count)) workers.emplace_back(run);
  } catch (const std::system_error&) {
    // Continue with the threads started so far.
  }
  run();
  for (std::thread& other : workers) other.join();
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace unlidar
