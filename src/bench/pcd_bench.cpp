// Speed of reading PCD files: ours, PCL's and `cat` on the same files, one after the other.
#include <benchmark/benchmark.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/pcd.hpp"

namespace unlidar {
namespace {

constexpr unsigned kPoints = 20'000;  // the rays of a Mid-360 frame
constexpr int kFiles = 60;
constexpr int kCatTurns = 16;  // of all files, so that the start of `cat` is small beside its work

pcl::PointCloud<pcl::PointXYZI> RandomCloud() {
  std::mt19937 generator(1);
  std::normal_distribution<float> coordinate_m(0.0F, 30.0F);
  pcl::PointCloud<pcl::PointXYZI> cloud(kPoints, 1);
  for (pcl::PointXYZI& p : cloud) {
    p.x = coordinate_m(generator);
    p.y = coordinate_m(generator);
    p.z = coordinate_m(generator);
    p.intensity = static_cast<float>(generator() % 256);
  }
  return cloud;
}

enum class Encoding { kAscii, kBinary, kCompressed };

// Files of its own for each process, gone at its end.
class BenchFiles {
 public:
  explicit BenchFiles(Encoding encoding)
      : folder_(std::filesystem::temp_directory_path() /
                ("unlidar_bench_" + std::to_string(::getpid()))) {
    std::filesystem::create_directory(folder_);
    const auto cloud = RandomCloud();
    pcl::PCDWriter writer;
    for (int i = 0; i < kFiles; ++i) {
      const std::string path = (folder_ / (std::to_string(i) + ".pcd")).string();
      if (encoding == Encoding::kAscii) writer.writeASCII(path, cloud);
      if (encoding == Encoding::kBinary) writer.writeBinary(path, cloud);
      if (encoding == Encoding::kCompressed) writer.writeBinaryCompressed(path, cloud);
      paths_.push_back(path);
      bytes_ += static_cast<double>(std::filesystem::file_size(path));
    }
  }
  ~BenchFiles() { std::filesystem::remove_all(folder_); }
  BenchFiles(const BenchFiles&) = delete;
  BenchFiles& operator=(const BenchFiles&) = delete;
  const std::vector<std::string>& paths() const { return paths_; }
  double bytes() const { return bytes_; }
  std::string CatCommand() const {
    std::string command = "cat";
    for (int i = 0; i < kCatTurns; ++i) command += " '" + folder_.string() + "'/*.pcd";
    return command + " >/dev/null";
  }

 private:
  std::filesystem::path folder_;
  std::vector<std::string> paths_;
  double bytes_ = 0.0;
};

template <typename Step>
double SecondsOf(const Step& step) {
  const auto begin = std::chrono::steady_clock::now();
  step();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void ReadByTurns(benchmark::State& state, Encoding encoding) {
  const BenchFiles files(encoding);
  const std::string cat = files.CatCommand();
  double ours_s = 0.0;
  double pcl_s = 0.0;
  double cat_s = 0.0;
  double bytes = 0.0;
  for ([[maybe_unused]] const auto iteration : state) {
    const double step_s = SecondsOf([&] {
      for (const std::string& path : files.paths()) benchmark::DoNotOptimize(ReadPcd(path));
    });
    state.SetIterationTime(step_s);
    ours_s += step_s;
    pcl_s += SecondsOf([&] {
      for (const std::string& path : files.paths()) {
        pcl::PointCloud<pcl::PointXYZ> cloud;
        pcl::io::loadPCDFile(path, cloud);
        benchmark::DoNotOptimize(cloud);
      }
    });
    cat_s += SecondsOf([&] {
      if (std::system(cat.c_str()) != 0) throw std::runtime_error("cat failed");
    });
    bytes += files.bytes();
  }
  state.counters["ours_bytes_per_s"] = bytes / ours_s;
  state.counters["pcl_bytes_per_s"] = bytes / pcl_s;
  state.counters["cat_bytes_per_s"] = kCatTurns * bytes / cat_s;
}

BENCHMARK_CAPTURE(ReadByTurns, ascii, Encoding::kAscii)->UseManualTime();
BENCHMARK_CAPTURE(ReadByTurns, binary, Encoding::kBinary)->UseManualTime();
BENCHMARK_CAPTURE(ReadByTurns, compressed, Encoding::kCompressed)->UseManualTime();

}  // namespace
}  // namespace unlidar
