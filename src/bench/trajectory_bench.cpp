#include <benchmark/benchmark.h>

#include <cmath>
#include <random>
#include <vector>

#include "trajectory/trajectory.hpp"

namespace {

std::vector<unlidar::Measurement> Flight(int measurements, double outlier_share) {
  std::mt19937_64 generator(1);
  std::normal_distribution<double> normal;
  std::vector<unlidar::Measurement> flight(static_cast<std::size_t>(measurements));
  for (std::size_t i = 0; i < flight.size(); ++i) {
    const double t = 30.0 * static_cast<double>(i) / measurements;
    flight[i].time_ns = static_cast<unlidar::TimeNs>(t * 1e9);
    flight[i].position_m << 20.0 * std::sin(0.5 * t), 15.0 * std::cos(0.4 * t), 15.0 + 0.2 * t;
    for (double& value : flight[i].position_m) value += 0.1 * normal(generator);
    flight[i].covariance_m2 *= 0.01;
    if (static_cast<double>(generator() % 1000) < 1000.0 * outlier_share) {
      flight[i].position_m.x() += 10.0;
    }
  }
  return flight;
}

void BM_FitTrajectory(benchmark::State& state) {
  const auto flight =
      Flight(static_cast<int>(state.range(0)), 0.01 * static_cast<double>(state.range(1)));
  for (auto _ : state) benchmark::DoNotOptimize(unlidar::FitTrajectory(flight, {}));
}
BENCHMARK(BM_FitTrajectory)
    ->ArgNames({"measurements", "percent_outliers"})
    ->ArgsProduct({{30, 600, 5000}, {0, 10}})
    ->Unit(benchmark::kMillisecond);

void BM_RefitTrajectory(benchmark::State& state) {
  const auto flight = Flight(static_cast<int>(state.range(0)), 0.0);
  for (auto _ : state) {
    benchmark::DoNotOptimize(unlidar::RefitTrajectory(flight, {5.0, 1.0}, {}));
  }
}
BENCHMARK(BM_RefitTrajectory)
    ->ArgName("measurements")
    ->Arg(30)
    ->Arg(600)
    ->Arg(5000)
    ->Unit(benchmark::kMillisecond);

}  // namespace
