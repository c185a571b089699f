// Any text as a stamp, as a rate and as a list of output times: what another reader of numbers
// makes of it, or nothing.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <regex>
#include <vector>

#include "app/output.hpp"
#include "fuzz/fuzz.hpp"
#include "io/stamp.hpp"
#include "trajectory/sampling.hpp"

namespace unlidar::fuzz {
namespace {

constexpr long double kMaxNs = static_cast<long double>(std::numeric_limits<TimeNs>::max());

// What the text says in nanoseconds, by the C library, whose long double holds 64 bits; empty for
// what is no number.
std::optional<long double> Nanoseconds(const std::string& text) {
  static const std::regex number("-?([0-9]+[.]?[0-9]*|[.][0-9]+)([eE][+-]?[0-9]+)?");
  if (!std::regex_match(text, number)) return std::nullopt;
  const long double value = std::strtold(text.c_str(), nullptr);
  const bool is_whole = text.find_first_of(".eE") == std::string::npos;
  const auto unit = is_whole ? NsPerUnitByMagnitude(static_cast<double>(std::abs(value)))
                             : std::int64_t{1'000'000'000};
  return value * static_cast<long double>(unit);
}

void CheckStamp(const std::string& text) {
  const std::optional<TimeNs> stamp = ParseStamp(text);
  const std::optional<long double> expected = Nanoseconds(text);
  Require(!stamp || expected, "a stamp is a number");
  if (stamp) {
    Require(std::abs(static_cast<long double>(*stamp) - *expected) <= 2.0L,
            "a stamp has the value of its number");
    Require(ParseStamp(SecondsText(*stamp)) == stamp, "a stamp survives writing and reading");
  } else if (expected && text.size() < 100) {
    Require(std::abs(*expected) >= kMaxNs - 2.0L || text.find_first_of("eE") != std::string::npos,
            "a number that fits is a stamp");
  }
}

void CheckList(std::string_view text) {
  const MemoryFile file(text);
  std::vector<TimeNs> stamps;
  if (!Succeeds([&] { stamps = ReadStampList(file.path()); })) return;
  Require(!stamps.empty(), "a list has a stamp");
  const auto not_ascending =
      std::adjacent_find(stamps.begin(), stamps.end(), std::greater_equal<>());
  Require(not_ascending == stamps.end(), "a list ascends");
  std::string written = "timestamp\n";
  for (const TimeNs stamp : stamps) written += SecondsText(stamp) + "\n";
  Require(ReadStampList(MemoryFile(written).path()) == stamps,
          "a list survives writing and reading");
}

// Instants of a recording that lasts about as long as 256 of them, wherever it begins.
void CheckRate(std::string_view text, TimeNs begin_ns) {
  Rate rate;
  if (!Succeeds([&] { rate = ParseRate(text); })) return;
  const double period_ns = 1e18 / static_cast<double>(rate.nanohertz);
  const auto span_ns = static_cast<TimeNs>(std::min(256.0 * period_ns, 9e18));
  FrameInfo frame;
  frame.begin_ns = std::min(begin_ns, std::numeric_limits<TimeNs>::max() - span_ns);
  frame.end_ns = frame.begin_ns + span_ns;
  Recording recording;
  recording.frames.push_back(frame);
  const OutputInstants instants = ResolveOutputTimes(rate, recording);
  Require(instants.size() > 0 && instants[0] == frame.begin_ns &&
              instants[instants.size() - 1] <= frame.end_ns,
          "instants run from the begin and not beyond the end");
  for (std::size_t k = 0; k < instants.size(); ++k) {
    const long double elapsed_ns = static_cast<long double>(instants[k]) - frame.begin_ns;
    const long double exact_ns = 1e18L * static_cast<long double>(k) / rate.nanohertz;
    Require(std::abs(elapsed_ns - exact_ns) <= 2.0L, "instants keep the rate");
  }
}

void Run(std::string_view bytes) {
  ByteReader reader(bytes);
  const std::string_view first = reader.Line();
  CheckStamp(std::string(first));
  CheckList(bytes);
  CheckRate(first, ParseStamp(reader.Line()).value_or(0));
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
