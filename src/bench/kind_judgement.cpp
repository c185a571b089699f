// How well the models of flight tell real paths apart:
// kind_judgement [--flat] [--svg FILE] LABEL=FILE...
// LABEL is drone or bird. A FILE is CSV with a header; its columns t or timestamp (seconds), x or
// tx, y or ty, and z or tz are read; with a column bird it holds a path of each number there. Each
// path is cut into windows of 5, 10 and 20 s that overlap by half, measured 10 times a second with
// normal noise and fitted as a target is. Heights that a file lacks are unknown, with --flat all.
//
// Calibration: what is said, p = drone / (drone + bird_like), against what is. Each file counts
// alike, as its windows are no independent flights, and drones in all as much as birds. --svg draws
// it: the area of a dot is the share of what is judged.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <map>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/fit_trajectory.hpp"
#include "trajectory/kind.hpp"
#include "trajectory/trajectory.hpp"

namespace unlidar {
namespace {

constexpr double kRateHz = 10.0;
constexpr double kLongestPauseS = 1.0;  // in a path: windows do not lead across longer ones

struct Path {
  bool is_drone = false;
  bool has_heights = false;
  std::string file;
  std::vector<double> times_s;
  std::vector<Eigen::Vector3d> positions_m;
};

// Returns the paths of one file, by the number in the column bird.
std::vector<Path> ReadPaths(const std::string& argument, bool is_flat) {
  const std::size_t equals = argument.find('=');
  Path empty;
  empty.is_drone = argument.substr(0, equals) == "drone";
  empty.file = argument.substr(equals + 1);
  std::ifstream file(empty.file);
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
  const std::size_t bird = column_of("bird", "");
  empty.has_heights = !is_flat && axes[2] < columns.size();
  std::map<double, Path> paths;
  while (std::getline(file, line)) {
    std::vector<double> values;
    for (std::istringstream row(line); std::getline(row, cell, ',');) {
      values.push_back(std::stod(cell));
    }
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
    for (int axis = 0; axis < (empty.has_heights ? 3 : 2); ++axis) {
      position_m[axis] = values[axes[axis]];
    }
    Path& path = paths.try_emplace(bird < values.size() ? values[bird] : 0.0, empty).first->second;
    // Repeated positions are none that were measured.
    if (!path.times_s.empty() &&
        (values[t] <= path.times_s.back() || position_m == path.positions_m.back())) {
      continue;
    }
    path.times_s.push_back(values[t]);
    path.positions_m.push_back(position_m);
  }
  std::vector<Path> result;
  result.reserve(paths.size());
  for (auto& [number, path] : paths) result.push_back(std::move(path));
  return result;
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

void ForgetHeights(Trajectory* trajectory) {
  constexpr double kUnknownM2 = 1e6;
  for (std::size_t z = 2; z < trajectory->covariance_m2.size(); z += 3) {
    for (int other_z = 0; other_z < kBandRows; other_z += 3) {
      trajectory->covariance_m2[z][other_z] += kUnknownM2;
    }
  }
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
  Trajectory trajectory = FitTrajectory(measurements, {});
  if (!path.has_heights) ForgetHeights(&trajectory);
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

struct Judgement {
  bool is_drone = false;
  std::string file;
  Kind kind;
};

double DroneShare(const Kind& kind) { return kind.drone / (kind.drone + kind.bird_like); }

// Weights of the judgements: files of a label count alike, and labels.
std::vector<double> WeightsOf(const std::vector<Judgement>& judgements) {
  std::map<std::string, double> of_file;
  for (const Judgement& j : judgements) of_file[j.file] += 1.0;
  std::map<std::string, bool> is_drone;
  for (const Judgement& j : judgements) is_drone[j.file] = j.is_drone;
  double files[2] = {};
  for (const auto& [file, of_drone] : is_drone) files[of_drone ? 1 : 0] += 1.0;
  const double labels = (files[0] > 0.0 ? 1.0 : 0.0) + (files[1] > 0.0 ? 1.0 : 0.0);
  std::vector<double> weights;
  weights.reserve(judgements.size());
  for (const Judgement& j : judgements) {
    weights.push_back(1.0 / (of_file[j.file] * files[j.is_drone ? 1 : 0] * labels));
  }
  return weights;
}

struct Bin {
  double weight = 0.0;
  double said = 0.0;  // weighted sums
  double drone = 0.0;
  std::set<std::string> files;
};
using Bins = std::array<Bin, 10>;

void WriteFigure(const Bins& bins, const std::string& path) {
  constexpr double kSide = 300.0;
  constexpr double kMargin = 50.0;
  std::ofstream file(path);
  const auto x = [](double said) { return kMargin + kSide * said; };
  const auto y = [](double observed) { return kMargin + kSide * (1.0 - observed); };
  file << std::fixed << std::setprecision(1)
       << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"400\" height=\"400\" "
          "font-family=\"sans-serif\" font-size=\"13\" text-anchor=\"middle\">\n"
       << "<rect width=\"400\" height=\"400\" fill=\"white\"/>\n"
       << "<path d=\"M" << x(0) << " " << y(1) << "V" << y(0) << "H" << x(1) << "M" << x(0) << " "
       << y(0) << "L" << x(1) << " " << y(1) << "\" fill=\"none\" stroke=\"#888\"/>\n";
  for (const double tick : {0.0, 0.5, 1.0}) {
    file << "<text x=\"" << x(tick) << "\" y=\"" << y(0) + 18.0 << "\">" << tick << "</text>\n"
         << "<text x=\"" << x(0) - 18.0 << "\" y=\"" << y(tick) + 4.0 << "\">" << tick
         << "</text>\n";
  }
  file << "<text x=\"" << x(0.5) << "\" y=\"" << y(0) + 40.0
       << "\">said: drone / (drone + bird_like)</text>\n"
       << "<text x=\"" << x(0.5) << "\" y=\"" << y(1) - 20.0
       << "\">share that were drones</text>\n";
  for (const Bin& bin : bins) {
    if (bin.weight == 0.0) continue;
    file << "<circle cx=\"" << x(bin.said / bin.weight) << "\" cy=\"" << y(bin.drone / bin.weight)
         << "\" r=\"" << 3.0 + 25.0 * std::sqrt(bin.weight)
         << "\" fill=\"#1f77b4\" fill-opacity=\"0.7\"/>\n";
  }
  file << "</svg>\n";
}

// Prints the log loss, the reliability by what is said, and who is among those that are said to be
// one kind with at least a probability. Returns the reliability.
Bins PrintCalibration(const std::vector<Judgement>& judgements) {
  Bins bins;
  const std::vector<double> weights = WeightsOf(judgements);
  double loss = 0.0;
  double label_loss[2] = {};  // birds, drones
  double label_weight[2] = {};
  for (std::size_t i = 0; i < judgements.size(); ++i) {
    const Judgement& j = judgements[i];
    const double p = DroneShare(j.kind);
    const double of_label = -weights[i] * std::log(j.is_drone ? p : 1.0 - p);
    loss += of_label;
    label_loss[j.is_drone ? 1 : 0] += of_label;
    label_weight[j.is_drone ? 1 : 0] += weights[i];
    Bin& bin = bins[std::min(bins.size() - 1,
                             static_cast<std::size_t>(p * static_cast<double>(bins.size())))];
    bin.weight += weights[i];
    bin.said += weights[i] * p;
    bin.drone += j.is_drone ? weights[i] : 0.0;
    bin.files.insert(j.file);
  }
  std::cout << "log loss " << loss << " (nothing said: " << std::log(2.0) << ")";
  if (label_weight[1] > 0.0) std::cout << ", drones " << label_loss[1] / label_weight[1];
  if (label_weight[0] > 0.0) std::cout << ", birds " << label_loss[0] / label_weight[0];
  std::cout << "\n";
  std::cout << "said,observed,weight,files\n";
  for (const Bin& bin : bins) {
    if (bin.weight == 0.0) continue;
    std::cout << bin.said / bin.weight << "," << bin.drone / bin.weight << "," << bin.weight << ","
              << bin.files.size() << "\n";
  }
  for (const double least : {0.5, 0.6, 0.7, 0.8, 0.9}) {
    double said[2] = {};  // bird-like, drone
    double wrong[2] = {};
    for (std::size_t i = 0; i < judgements.size(); ++i) {
      const Judgement& j = judgements[i];
      if (j.kind.bird_like >= least) said[0] += weights[i];
      if (j.kind.bird_like >= least && j.is_drone) wrong[0] += weights[i];
      if (j.kind.drone >= least) said[1] += weights[i];
      if (j.kind.drone >= least && !j.is_drone) wrong[1] += weights[i];
    }
    std::cout << ">= " << least << ": bird-like " << said[0] << ", of which drones "
              << (said[0] > 0.0 ? wrong[0] / said[0] : 0.0) << "; drone " << said[1]
              << ", of which birds " << (said[1] > 0.0 ? wrong[1] / said[1] : 0.0) << "\n";
  }
  return bins;
}

int Main(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool is_flat = !arguments.empty() && arguments[0] == "--flat";
  if (is_flat) arguments.erase(arguments.begin());
  std::string figure;
  if (arguments.size() > 1 && arguments[0] == "--svg") {
    figure = arguments[1];
    arguments.erase(arguments.begin(), arguments.begin() + 2);
  }
  std::vector<Path> paths;
  for (const std::string& argument : arguments) {
    for (Path& path : ReadPaths(argument, is_flat)) paths.push_back(std::move(path));
  }
  std::vector<Judgement> judgements;
  std::cout << std::fixed << std::setprecision(3);
  for (const double noise_m : {0.05, 0.2, 0.5}) {
    for (const double length_s : {5.0, 10.0, 20.0}) {
      std::mt19937 random(1);
      std::map<std::string, std::vector<Kind>> by_file;
      std::vector<Kind> kinds[2];  // birds, drones
      for (const Path& path : paths) {
        const double end_s = path.times_s.back() - length_s;
        for (double begin_s = path.times_s.front(); begin_s <= end_s; begin_s += 0.5 * length_s) {
          if (HasPause(path, begin_s, begin_s + length_s)) continue;
          const Kind kind = Judge(path, begin_s, length_s, noise_m, random);
          kinds[path.is_drone ? 1 : 0].push_back(kind);
          by_file[path.file].push_back(kind);
          judgements.push_back({path.is_drone, path.file, kind});
        }
      }
      std::cout << "noise " << noise_m << " m, " << length_s << " s";
      if (!kinds[0].empty() && !kinds[1].empty()) {
        std::cout << " | AUC " << AreaUnderRoc(kinds[1], kinds[0]);
      }
      if (!kinds[1].empty()) PrintKinds("drones", kinds[1]);
      if (!kinds[0].empty()) PrintKinds("birds", kinds[0]);
      std::cout << "\n";
      for (const auto& [name, of_file] : by_file) {
        std::cout << "   ";
        PrintKinds(name.substr(name.rfind('/') + 1).c_str(), of_file);
        std::cout << "\n";
      }
    }
  }
  const Bins bins = PrintCalibration(judgements);
  if (!figure.empty()) WriteFigure(bins, figure);
  return 0;
}

}  // namespace
}  // namespace unlidar

int main(int argc, char** argv) { return unlidar::Main(argc, argv); }
