#include "app/processing_times.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>

namespace unlidar {
namespace {

constexpr double kShortestS = 1e-6;
constexpr double kStep = 1.02;

}  // namespace

void ProcessingTimes::Add(double seconds) {
  const double steps =
      std::ceil(std::log(std::max(seconds, kShortestS) / kShortestS) / std::log(kStep));
  ++counts_[std::min(static_cast<std::size_t>(steps), kSteps - 1)];
  ++frames_;
  max_s_ = std::max(max_s_, seconds);
  sum_s_ += seconds;
}

double ProcessingTimes::Quantile(double share) const {
  const double wanted = share * static_cast<double>(frames_);
  std::uint64_t frames = 0;
  for (std::size_t i = 0; i + 1 < kSteps; ++i) {
    frames += counts_[i];
    if (frames > 0 && static_cast<double>(frames) >= wanted) {
      return std::min(max_s_, kShortestS * std::pow(kStep, static_cast<double>(i)));
    }
  }
  return max_s_;
}

double ThreadCpuSeconds() {
  timespec used = {};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

}  // namespace unlidar
