// Mutated files: whatever the bytes say, the reader ends with points or an InputError, reads
// nothing behind the last byte (a page without access follows it) and allocates in proportion to
// the file.
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <new>
#include <random>
#include <string>
#include <vector>

#include "io/pcd.hpp"
#include "io/pcd_format.hpp"
#include "tests/pcd_oracle.hpp"
#include "tests/pcd_writer.hpp"
#include "unlidar/error.hpp"

namespace {
thread_local std::size_t largest_allocation = 0;
}  // namespace

void* operator new(std::size_t size) {
  largest_allocation = std::max(largest_allocation, size);
  if (void* const memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace unlidar {
namespace {

// Memory that ends at a page without access.
class GuardedBytes {
 public:
  explicit GuardedBytes(std::size_t capacity)
      : page_(static_cast<std::size_t>(::sysconf(_SC_PAGESIZE))),
        capacity_((capacity + page_ - 1) / page_ * page_) {
    void* const memory = ::mmap(nullptr, capacity_ + page_, PROT_READ | PROT_WRITE,
                                MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) throw std::bad_alloc();
    memory_ = static_cast<char*>(memory);
    ::mprotect(memory_ + capacity_, page_, PROT_NONE);
  }
  ~GuardedBytes() { ::munmap(memory_, capacity_ + page_); }
  GuardedBytes(const GuardedBytes&) = delete;
  GuardedBytes& operator=(const GuardedBytes&) = delete;

  char* Last(std::size_t size) { return memory_ + capacity_ - size; }

  std::string_view Hold(const std::string& bytes) {
    std::copy(bytes.begin(), bytes.end(), Last(bytes.size()));
    return {Last(bytes.size()), bytes.size()};
  }

 private:
  std::size_t page_;
  std::size_t capacity_;
  char* memory_ = nullptr;
};

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  testing::TestCloud cloud{
      {{"x"}, {"_", 'U', 1, 3}, {"y", 'F', 8}, {"z"}, {"t", 'U', 4}, {"ring", 'I', 2}}, {}};
  for (int row = 0; row < 12; ++row) {
    const double r = row;
    cloud.values.push_back({r, 1.0, 2.0, 3.0, r / 7.0, -r, 1000.0 * r, r});
  }
  using testing::TestEncoding;
  for (const TestEncoding encoding :
       {TestEncoding::kAscii, TestEncoding::kBinary, TestEncoding::kCompressed,
        TestEncoding::kCompressedWithPadding}) {
    seeds.push_back(testing::Encoded(cloud, encoding));
  }
  for (const auto& path : testing::SharedPcdFiles("readable")) {
    if (std::filesystem::file_size(path) > 5000) continue;
    std::ifstream file(path, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return seeds;
}

class Mutator {
 public:
  explicit Mutator(const std::vector<std::string>& seeds) : seeds_(seeds) {}

  std::string Next() {
    std::string bytes = seeds_[Below(seeds_.size())];
    for (std::size_t steps = 1 + Below(4); steps > 0; --steps) Change(bytes);
    return bytes;
  }

 private:
  std::size_t Below(std::size_t limit) { return generator_() % std::max<std::size_t>(limit, 1); }

  // A place in the header in half of the cases: that is where the sizes are.
  std::size_t Place(const std::string& bytes) {
    const std::size_t header = std::min(bytes.find("DATA"), bytes.size());
    return Below(Below(2) == 0 ? header : bytes.size());
  }

  void Change(std::string& bytes) {
    if (bytes.empty()) return;
    const std::size_t at = Place(bytes);
    switch (Below(8)) {
      case 0:
        bytes[at] = static_cast<char>(Below(256));
        return;
      case 1:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << Below(8)));
        return;
      case 2:
        bytes.resize(at);
        return;
      case 3:
        bytes.erase(at, 1 + Below(20));
        return;
      case 4:
        bytes.insert(at, bytes.substr(Below(bytes.size()), 1 + Below(40)));
        return;
      case 5:
        ReplaceNumber(bytes, at);
        return;
      case 6:
        bytes.replace(at, 4, std::string(4, static_cast<char>(Below(2) == 0 ? 0xff : 0)));
        return;
      default:
        MixLines(bytes);
    }
  }

  void ReplaceNumber(std::string& bytes, std::size_t at) {
    static const std::vector<std::string> kNumbers = {"0",
                                                      "1",
                                                      "-1",
                                                      "3",
                                                      "8",
                                                      "255",
                                                      "65536",
                                                      "2147483647",
                                                      "2147483648",
                                                      "4294967295",
                                                      "4294967296",
                                                      "9223372036854775807",
                                                      "18446744073709551615",
                                                      "1e9",
                                                      "nan",
                                                      ""};
    const std::size_t begin = bytes.find_first_of("0123456789", at);
    if (begin == std::string::npos) return;
    const std::size_t end = std::min(bytes.find_first_not_of("0123456789", begin), bytes.size());
    bytes.replace(begin, end - begin, kNumbers[Below(kNumbers.size())]);
  }

  // A line of another seed's header in front of a line of this one.
  void MixLines(std::string& bytes) {
    const std::string& other = seeds_[Below(seeds_.size())];
    const std::size_t from = other.find('\n', Below(other.find("DATA")));
    const std::size_t to = bytes.find('\n', Below(bytes.find("DATA")));
    if (from == std::string::npos || to == std::string::npos) return;
    const std::size_t end = std::min(other.find('\n', from + 1), other.size());
    bytes.insert(to, other.substr(from, end - from));
  }

  const std::vector<std::string>& seeds_;
  std::mt19937 generator_{11};
};

TEST(PcdMutations, NoFileCrashesTheReaderOrMakesItReadOrAllocateBeyondItsSize) {
  const std::vector<std::string> seeds = Seeds();
  Mutator mutator(seeds);
  GuardedBytes guarded(1 << 20);
  int num_read = 0;
  int num_refused = 0;
  for (int trial = 0; trial < 100'000; ++trial) {
    const std::string bytes = mutator.Next();
    const std::string_view held = guarded.Hold(bytes);
    const std::string name = "mutated.pcd";
    largest_allocation = 0;
    try {
      const PcdCloud cloud = ParsePcd(held, name);
      ++num_read;
      if (!cloud.integer_times.empty()) {
        ASSERT_EQ(cloud.integer_times.size(), cloud.points_m.size());
      }
    } catch (const InputError& error) {
      ++num_refused;
      const std::string message = error.what();
      ASSERT_EQ(message.find('\n'), std::string::npos) << message;
    }
    // The smallest row of two values of a byte becomes a point of twelve and a time of eight.
    ASSERT_LE(largest_allocation, 6 * kLzfMaxExpansion * bytes.size() + 4096)
        << bytes.substr(0, 400);
  }
  EXPECT_GT(num_read, 5'000);
  EXPECT_GT(num_refused, 5'000);
}

TEST(PcdMutations, EveryTruncationIsRefusedOrGivesAllPoints) {
  GuardedBytes guarded(1 << 20);
  for (const std::string& seed : Seeds()) {
    const std::size_t num_points = ParsePcd(seed, "seed").points_m.size();
    for (std::size_t size = 0; size < seed.size(); ++size) {
      const std::string_view held = guarded.Hold(seed.substr(0, size));
      try {
        EXPECT_EQ(ParsePcd(held, "cut").points_m.size(), num_points);
      } catch (const InputError&) {
      }
    }
  }
}

TEST(PcdMutations, RandomLzfStreamsStayWithinTheirBuffers) {
  std::mt19937 generator(13);
  GuardedBytes in(1 << 12);
  GuardedBytes out(1 << 16);
  for (int trial = 0; trial < 200'000; ++trial) {
    std::string stream(generator() % 64, '\0');
    for (char& c : stream) c = static_cast<char>(generator() % (trial % 2 == 0 ? 256 : 40));
    const std::string_view held = in.Hold(stream);
    const std::size_t room = generator() % 600;
    char* const before = out.Last(room + 1);
    *before = 'x';
    LzfDecompress(reinterpret_cast<const std::uint8_t*>(held.data()), held.size(),
                  reinterpret_cast<std::uint8_t*>(out.Last(room)), room);
    ASSERT_EQ(*before, 'x');
  }
}

}  // namespace
}  // namespace unlidar
