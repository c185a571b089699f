// Any text as a configuration file and any as an assignment of --set, in front of it and apart by a
// byte of zero: a configuration or an error; and what is listed of one gives the same one again.
#include <string>
#include <vector>

#include "config/config.hpp"
#include "fuzz/fuzz.hpp"
#include "tests/config_entries.hpp"

namespace unlidar::fuzz {
namespace {

std::vector<std::string> Assignments(const Config& config) {
  std::vector<std::string> assignments;
  for (const testing::ConfigEntry& entry : testing::ListConfig(config)) {
    assignments.push_back(entry.key + "=" + entry.value.dump());
  }
  return assignments;
}

void Run(std::string_view bytes) {
  ByteReader reader(bytes);
  std::vector<std::string> assignments;
  if (bytes.find('\0') != std::string_view::npos) assignments.emplace_back(reader.Line());
  const MemoryFile file(bytes.substr(assignments.empty() ? 0 : assignments[0].size() + 1));

  Config config;
  if (!Succeeds([&] { config = LoadConfig(file.path(), assignments); })) return;
  Require(Succeeds([&] { CheckConfig(config); }), "what is loaded satisfies all constraints");
  const std::vector<std::string> listed = Assignments(config);
  Require(Assignments(LoadConfig("", listed)) == listed, "what is listed gives the same again");
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
