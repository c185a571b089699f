#include "app/console.hpp"

#include <cstddef>

#include "app/output_files.hpp"
#include "base/format.hpp"

namespace unlidar {
namespace {

// Two paths of the longest that there are, and what is said of them.
constexpr std::size_t kMaxTextBytes = 10'000;

}  // namespace

void PrintResult(const std::string& text) { WriteToStdout(Shortened(text, kMaxTextBytes) + "\n"); }

void PrintNote(const std::string& text) {
  WriteToStderr("unlidar_track: " + Shortened(text, kMaxTextBytes) + "\n");
}

}  // namespace unlidar
