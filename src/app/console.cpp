#include "app/console.hpp"

#include <cstddef>

#include "app/output_files.hpp"
#include "base/format.hpp"

namespace unlidar {
namespace {

// Room for two paths of maximum length and a message.
constexpr std::size_t kMaxTextBytes = 10'000;

}  // namespace

void PrintResult(const std::string& text) { WriteToStdout(Shortened(text, kMaxTextBytes) + "\n"); }

void PrintNote(const std::string& text) {
  WriteToStderr("unlidar_track: " + Shortened(text, kMaxTextBytes) + "\n");
}

}  // namespace unlidar
