// Speed of the spline fit on measurements from files, one flight each.
//   trajectory_bench FILE... [OPTION OF GOOGLE BENCHMARK...]
// A row of a file is `t x y z sigma`: seconds in ascending order, metres. The fit goes to
// FILE.fitted: rows `t x y z` at evenly spaced times from the first measurement to the last.
#include <benchmark/benchmark.h>

#include <cmath>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <string>
#include <vector>

#include "tests/fit_trajectory.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {
namespace {

constexpr int kFittedRows = 2'001;

std::vector<Measurement> ReadMeasurements(const std::string& path) {
  std::ifstream file(path);
  std::vector<Measurement> measurements;
  double time_s = 0.0;
  Eigen::Vector3d p_m;
  double sigma_m = 0.0;
  while (file >> time_s >> p_m.x() >> p_m.y() >> p_m.z() >> sigma_m) {
    Measurement measurement;
    measurement.time_ns = std::llround(time_s / kSecondsPerNs);
    measurement.position_m = p_m;
    measurement.covariance_m2 *= sigma_m * sigma_m;
    measurements.push_back(measurement);
  }
  return measurements;
}

void WriteFitted(const std::string& path, const Trajectory& trajectory) {
  std::ofstream file(path);
  file << std::setprecision(12);
  for (int i = 0; i < kFittedRows; ++i) {
    const TimeNs time_ns = trajectory.begin_ns() + trajectory.duration_ns / (kFittedRows - 1) * i;
    file << static_cast<double>(time_ns) * kSecondsPerNs << " "
         << trajectory.At(time_ns).position_m.transpose() << "\n";
  }
}

int Main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  for (int i = 1; i < argc; ++i) {
    const std::string path = argv[i];
    const std::vector<Measurement> flight = ReadMeasurements(path);
    if (flight.empty()) {
      std::cerr << path << ": no rows, expected t x y z sigma\n";
      return 4;
    }
    const Trajectory fitted = FitTrajectory(flight, {});
    WriteFitted(path + ".fitted", fitted);
    benchmark::RegisterBenchmark((path + "/fit").c_str(), [flight](benchmark::State& state) {
      for ([[maybe_unused]] const auto iteration : state) {
        benchmark::DoNotOptimize(FitTrajectory(flight, {}));
      }
    })->Unit(benchmark::kMillisecond);
    const TrajectoryScales scales = fitted.scales;
    benchmark::RegisterBenchmark((path + "/refit").c_str(), [flight,
                                                             scales](benchmark::State& state) {
      for ([[maybe_unused]] const auto iteration : state) {
        benchmark::DoNotOptimize(RefitTrajectory(flight, scales, {}));
      }
    })->Unit(benchmark::kMillisecond);
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

}  // namespace
}  // namespace unlidar

int main(int argc, char** argv) { return unlidar::Main(argc, argv); }
