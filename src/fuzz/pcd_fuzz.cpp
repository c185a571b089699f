// Any bytes as a PCD file: points or an InputError, the same every time, and points survive being
// written and read again.
#include <algorithm>
#include <cstring>
#include <vector>

#include "fuzz/fuzz.hpp"
#include "io/pcd.hpp"

namespace unlidar::fuzz {
namespace {

template <typename T>
bool SameBytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void RequireSound(const PcdCloud& cloud) {
  const std::size_t rows = cloud.points_m.size();
  const std::size_t times = cloud.integer_times.size() + cloud.floating_times.size();
  Require(times == 0 || (times == rows &&
                         std::min(cloud.integer_times.size(), cloud.floating_times.size()) == 0),
          "a row has a time of one kind if the cloud has times");
}

void Run(std::string_view bytes) {
  PcdCloud cloud;
  if (!Succeeds([&] { cloud = ParsePcd(bytes, "fuzz.pcd"); })) return;
  RequireSound(cloud);

  const PcdCloud again = ParsePcd(bytes, "again.pcd");
  Require(SameBytes(again.points_m, cloud.points_m) &&
              SameBytes(again.integer_times, cloud.integer_times) &&
              SameBytes(again.floating_times, cloud.floating_times),
          "the same bytes give the same cloud");

  const PcdCloud copy = ParsePcd(BinaryPcd(cloud.points_m), "copy.pcd");
  Require(SameBytes(copy.points_m, cloud.points_m), "points survive writing and reading");
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
