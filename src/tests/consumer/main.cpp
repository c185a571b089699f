// Simulates a few seconds of a LiDAR below a drone and prints where the drone is found: once from
// the recording as a whole, once while the frames come.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <random>
#include <unlidar/engine.hpp>
#include <unlidar/error.hpp>
#include <unlidar/track_recording.hpp>
#include <utility>
#include <variant>
#include <vector>

namespace {

constexpr int kFrames = 150;
constexpr int kFirstWithDrone = 60;
constexpr unlidar::TimeNs kPeriodNs = 100'000'000;
constexpr unlidar::TimeNs kBeginNs = 1'700'000'000'000'000'000;

// Eight metres up, at 2 m/s along x.
Eigen::Vector3d DroneAt(unlidar::TimeNs time_ns) {
  const double time_s = static_cast<double>(time_ns - kBeginNs) * unlidar::kSecondsPerNs;
  return {2.0 * (time_s - 9.0), 6.0, 8.0};
}

// The ground, two metres below the sensor, with its ray times; and the drone from some time on.
unlidar::Frame SimulatedFrame(int i) {
  static std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  unlidar::Frame frame;
  frame.stamp_ns = kBeginNs + i * kPeriodNs;
  const auto add = [&](const Eigen::Vector3d& point_m, std::int64_t offset_ns) {
    frame.points_m.push_back(point_m.cast<float>());
    frame.offsets_ns.push_back(offset_ns);
  };
  constexpr int kRays = 500;
  for (int ray = 0; ray < kRays; ++ray) {
    const std::int64_t offset_ns = kPeriodNs * ray / kRays;
    add({20.0 * uniform(generator), 20.0 * uniform(generator), -2.0 + 0.02 * uniform(generator)},
        offset_ns);
    if (i < kFirstWithDrone || ray % 125 != 0) continue;
    add(DroneAt(frame.stamp_ns + offset_ns) +
            0.1 * Eigen::Vector3d(uniform(generator), uniform(generator), uniform(generator)),
        offset_ns);
  }
  return frame;
}

struct Error {
  int rows = 0;
  double largest_m = 0.0;

  void Add(const unlidar::TrajectoryRow& row) {
    ++rows;
    largest_m = std::max(largest_m, (row.position_m - DroneAt(row.time_ns)).norm());
  }
};

bool Report(const char* what, std::size_t tracks, const Error& error) {
  std::printf("%s: %zu tracks, %d rows, at most %.2f m off\n", what, tracks, error.rows,
              error.largest_m);
  return tracks == 1 && error.rows > kFrames / 3 && error.largest_m < 0.5;
}

bool Run() {
  std::vector<unlidar::Frame> frames;
  for (int i = 0; i < kFrames; ++i) frames.push_back(SimulatedFrame(i));
  const unlidar::Config config = unlidar::LoadConfig("", {"live.delay_s=0.5"});

  Error of_recording;
  const std::vector<unlidar::Track> tracks = unlidar::TrackRecording(config, {"roof"}, frames);
  for (const unlidar::Track& track : tracks) {
    for (const unlidar::TrajectoryRow& row : track.rows) of_recording.Add(row);
  }

  Error while_they_come;
  std::size_t confirmed = 0;
  unlidar::Engine engine(config, {"roof"}, [&](const unlidar::EngineEvent& event) {
    if (std::holds_alternative<unlidar::TrackConfirmed>(event)) ++confirmed;
    if (const auto* given = std::get_if<unlidar::RowGiven>(&event)) while_they_come.Add(given->row);
  });
  for (unlidar::Frame& frame : frames) engine.Add(std::move(frame));
  engine.Advance(kBeginNs + (kFrames + 10) * kPeriodNs);
  engine.Close();

  const bool recording_holds = Report("recording", tracks.size(), of_recording);
  return Report("live", confirmed, while_they_come) && recording_holds;
}

}  // namespace

int main() {
  try {
    return Run() ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "consumer: %s\n", error.what());
    return 1;
  }
}
