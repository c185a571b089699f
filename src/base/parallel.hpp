// Independent pieces of work on several threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <system_error>
#include <thread>
#include <vector>

namespace unlidar {

// How many threads the process may use at a time, 1 unless it is set. Results never depend on it.
inline std::atomic<int>& MaxThreads() {
  static std::atomic<int> threads{1};
  return threads;
}

// Calls work(i) once for each i below `count`, in any order, on MaxThreads() threads, the caller's
// among them, or fewer where the system gives no more. `work` must not touch what another call
// writes. When all have ended, throws what the call with the lowest i has thrown.
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
    // The threads that there are do the work.
  }
  run();
  for (std::thread& other : workers) other.join();
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace unlidar
