// Speed of reading PCD files: ours and PCL's on the same file, one after the other. The counter
// `times_faster` of a file is the ratio of both within this run.
#include <benchmark/benchmark.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "io/pcd.hpp"

namespace unlidar {
namespace {

constexpr unsigned kPoints = 20'000;  // the rays of a Mid-360 frame

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

// A file of its own for each process, gone at its end.
class BenchFile {
 public:
  explicit BenchFile(Encoding encoding)
      : path_((std::filesystem::temp_directory_path() /
               ("unlidar_bench_" + std::to_string(::getpid()) + ".pcd"))
                  .string()) {
    const auto cloud = RandomCloud();
    pcl::PCDWriter writer;
    if (encoding == Encoding::kAscii) writer.writeASCII(path_, cloud);
    if (encoding == Encoding::kBinary) writer.writeBinary(path_, cloud);
    if (encoding == Encoding::kCompressed) writer.writeBinaryCompressed(path_, cloud);
  }
  ~BenchFile() { std::filesystem::remove(path_); }
  BenchFile(const BenchFile&) = delete;
  BenchFile& operator=(const BenchFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

template <typename Step>
double SecondsOf(const Step& step) {
  const auto begin = std::chrono::steady_clock::now();
  step();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void ReadByTurns(benchmark::State& state, Encoding encoding) {
  const BenchFile file(encoding);
  double ours_s = 0.0;
  double pcl_s = 0.0;
  for ([[maybe_unused]] const auto iteration : state) {
    const double step_s = SecondsOf([&] { benchmark::DoNotOptimize(ReadPcd(file.path())); });
    state.SetIterationTime(step_s);
    ours_s += step_s;
    pcl_s += SecondsOf([&] {
      pcl::PointCloud<pcl::PointXYZ> cloud;
      pcl::io::loadPCDFile(file.path(), cloud);
      benchmark::DoNotOptimize(cloud);
    });
  }
  state.counters["times_faster"] = pcl_s / ours_s;
}

BENCHMARK_CAPTURE(ReadByTurns, ascii, Encoding::kAscii)->UseManualTime();
BENCHMARK_CAPTURE(ReadByTurns, binary, Encoding::kBinary)->UseManualTime();
BENCHMARK_CAPTURE(ReadByTurns, compressed, Encoding::kCompressed)->UseManualTime();

}  // namespace
}  // namespace unlidar
