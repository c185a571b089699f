// How well the models of flight tell real paths apart: kind_judgement [--flat] LABEL=FILE...
// LABEL is drone or bird. A FILE is CSV with a header; its columns t or timestamp (seconds), x or
// tx, y or ty, and z or tz (left out: level flight) are read. Each path is cut into windows of 5,
// 10 and 20 s that overlap by half, measured 10 times a second with normal noise and fitted as a
// target is. --flat takes the heights away, for paths of both labels to be alike where some have
// none.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <map>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "trajectory/kind.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {
namespace {

constexpr double kRateHz = 10.0;
constexpr double kLongestPauseS = 1.0;  // in a path: windows do not lead across longer ones

struct Path {
  bool is_drone = false;
  std::string name;
  std::vector<double> times_s;
  std::vector<Eigen::Vector3d> positions_m;
};

Path ReadPath(const std::string& argument, bool is_flat) {
  const std::size_t equals = argument.find('=');
  Path path;
  path.is_drone = argument.substr(0, equals) == "drone";
  path.name = argument.substr(equals + 1);
  std::ifstream file(path.name);
  std::string line;
  std::getline(file, line);
  std::map<std::string, std::size_t> columns;
  std::string cell;
  for (std::istringstream header(line); std::getline(header, cell, ',');) {
    const std::size_t column = columns.size();
    columns[cell] = column;
  }
  const auto column_of = [&](const char* name, const char* other) {
    return columns.count(name) > 0 ? columns[name] : columns.count(other) > 0 ? columns[other] : 99;
  };
  const std::size_t t = column_of("t", "timestamp");
  const std::size_t axes[3] = {column_of("x", "tx"), column_of("y", "ty"), column_of("z", "tz")};
  while (std::getline(file, line)) {
    std::vector<double> values;
    for (std::istringstream row(line); std::getline(row, cell, ',');) {
      values.push_back(std::stod(cell));
    }
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
    for (int axis = 0; axis < (is_flat ? 2 : 3); ++axis) {
      if (axes[axis] < values.size()) position_m[axis] = values[axes[axis]];
    }
    if (!path.times_s.empty() && values[t] <= path.times_s.back()) continue;
    path.times_s.push_back(values[t]);
    path.positions_m.push_back(position_m);
  }
  return path;
}

// Between two rows by Catmull and Rom: straight lines would be flown by nobody.
Eigen::Vector3d PositionAt(const Path& path, double time_s) {
  const auto above = std::lower_bound(path.times_s.begin(), path.times_s.end(), time_s);
  const std::size_t n = path.times_s.size();
  const auto next =
      std::clamp<std::size_t>(static_cast<std::size_t>(above - path.times_s.begin()), 1, n - 1);
  const std::size_t at = next - 1;
  const double span_s = path.times_s[next] - path.times_s[at];
  const double u = std::clamp((time_s - path.times_s[at]) / span_s, 0.0, 1.0);
  const auto slope_mps = [&](std::size_t i) -> Eigen::Vector3d {
    const std::size_t a = i == 0 ? 0 : i - 1;
    const std::size_t b = std::min(i + 1, n - 1);
    return (path.positions_m[b] - path.positions_m[a]) / (path.times_s[b] - path.times_s[a]);
  };
  const double v = 1.0 - u;
  return (1.0 + 2.0 * u) * v * v * path.positions_m[at] + u * v * v * span_s * slope_mps(at) +
         u * u * (3.0 - 2.0 * u) * path.positions_m[next] - u * u * v * span_s * slope_mps(next);
}

bool HasPause(const Path& path, double begin_s, double end_s) {
  for (std::size_t i = 1; i < path.times_s.size(); ++i) {
    if (path.times_s[i] > begin_s && path.times_s[i - 1] < end_s &&
        path.times_s[i] - path.times_s[i - 1] > kLongestPauseS) {
      return true;
    }
  }
  return false;
}

Kind Judge(const Path& path, double begin_s, double length_s, double noise_m,
           std::mt19937& random) {
  std::normal_distribution<double> normal(0.0, noise_m);
  std::vector<Measurement> measurements;
  for (int i = 0; i <= static_cast<int>(length_s * kRateHz); ++i) {
    Measurement m;
    m.time_ns = std::llround(i / kRateHz / kSecondsPerNs);
    m.position_m = PositionAt(path, begin_s + i / kRateHz) +
                   Eigen::Vector3d(normal(random), normal(random), normal(random));
    m.covariance_m2 *= noise_m * noise_m;
    measurements.push_back(m);
  }
  const Trajectory trajectory = FitTrajectory(measurements, {});
  KindFilter filter;
  filter.Observe(trajectory, trajectory.end_ns());
  return filter.kind();
}

// Of one drone and one bird: that the drone has the higher probability. Ties count half.
double AreaUnderRoc(const std::vector<Kind>& drones, const std::vector<Kind>& birds) {
  double wins = 0.0;
  for (const Kind& a : drones) {
    for (const Kind& b : birds) {
      wins += a.drone > b.drone ? 1.0 : a.drone == b.drone ? 0.5 : 0.0;
    }
  }
  return wins / static_cast<double>(drones.size() * birds.size());
}

void PrintKinds(const char* name, const std::vector<Kind>& kinds) {
  const auto share = [&](const auto& is) {
    return static_cast<double>(std::count_if(kinds.begin(), kinds.end(), is)) /
           static_cast<double>(kinds.size());
  };
  std::cout << " | " << kinds.size() << " " << name << ": drone >= 0.5 "
            << share([](const Kind& k) { return k.drone >= 0.5; }) << ", >= 0.9 "
            << share([](const Kind& k) { return k.drone >= 0.9; }) << ", bird-like >= 0.5 "
            << share([](const Kind& k) { return k.bird_like >= 0.5; }) << ", unknown >= 0.5 "
            << share([](const Kind& k) { return k.unknown >= 0.5; });
}

int Main(int argc, char** argv) {
  const bool is_flat = argc > 1 && std::string(argv[1]) == "--flat";
  std::vector<Path> paths;
  for (int i = is_flat ? 2 : 1; i < argc; ++i) paths.push_back(ReadPath(argv[i], is_flat));
  std::cout << std::fixed << std::setprecision(3);
  for (const double noise_m : {0.05, 0.2, 0.5}) {
    for (const double length_s : {5.0, 10.0, 20.0}) {
      std::mt19937 random(1);
      std::map<std::string, std::vector<Kind>> by_path;
      std::vector<Kind> kinds[2];  // birds, drones
      for (const Path& path : paths) {
        const double end_s = path.times_s.back() - length_s;
        for (double begin_s = path.times_s.front(); begin_s <= end_s; begin_s += 0.5 * length_s) {
          if (HasPause(path, begin_s, begin_s + length_s)) continue;
          const Kind kind = Judge(path, begin_s, length_s, noise_m, random);
          kinds[path.is_drone ? 1 : 0].push_back(kind);
          by_path[path.name].push_back(kind);
        }
      }
      std::cout << "noise " << noise_m << " m, " << length_s << " s";
      if (!kinds[0].empty() && !kinds[1].empty()) {
        std::cout << " | AUC " << AreaUnderRoc(kinds[1], kinds[0]);
      }
      if (!kinds[1].empty()) PrintKinds("drones", kinds[1]);
      if (!kinds[0].empty()) PrintKinds("birds", kinds[0]);
      std::cout << "\n";
      for (const auto& [name, of_path] : by_path) {
        std::cout << "   ";
        PrintKinds(name.substr(name.rfind('/') + 1).c_str(), of_path);
        std::cout << "\n";
      }
    }
  }
  return 0;
}

}  // namespace
}  // namespace unlidar

int main(int argc, char** argv) { return unlidar::Main(argc, argv); }
