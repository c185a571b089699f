#include "io/frame_directory.hpp"

#include <dirent.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <new>
#include <system_error>

#include "base/algorithms.hpp"
#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/input_file.hpp"
#include "io/stamp.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kStampHeader = "file,timestamp";

constexpr std::uint64_t kHourS = 3600;

struct NumberUnit {
  std::uint64_t min_step;
  std::uint64_t max_step;
  double rate_hz;
  const char* words;
};

constexpr std::array<NumberUnit, 4> kUnits = {{
    {0, 19, 10.0, "the numbers of frames, 10 frames a second"},
    {20, 2'000, 1e3, "milliseconds"},
    {20'000, 2'000'000, 1e6, "microseconds"},
    {20'000'000, 2'000'000'000, 1e9, "nanoseconds"},
}};

// `numbers`: ascending; `median_step`: of these, 0 for a single one.
bool AreNumbers(const std::vector<std::uint64_t>& numbers, std::uint64_t median_step) {
  if (numbers.front() < kMinUnixS) return true;
  const bool are_seconds =
      NsPerUnitByMagnitude(static_cast<double>(numbers.back())) == kNsPerSecond;
  return are_seconds && median_step > kHourS;
}

using StampsByFile = std::map<std::string, TimeNs, std::less<>>;

struct CloseFolder {
  void operator()(DIR* folder) const { closedir(folder); }
};

// Uses readdir: std::filesystem iterators terminate the program if an allocation fails, since their
// increment is noexcept.
std::vector<std::string> FrameNames(const std::string& directory) {
  const auto check = [&](bool is_fine) {
    if (is_fine) return;
    if (errno == ENOMEM) throw std::bad_alloc();
    throw InputError(directory + ": " + std::generic_category().message(errno) +
                     ", expected a directory of .pcd frames");
  };
  const std::unique_ptr<DIR, CloseFolder> folder(opendir(directory.c_str()));
  check(folder != nullptr);
  std::vector<std::string> names;
  std::string subfolder;  // the first by name
  while (true) {
    errno = 0;
    const dirent* entry = readdir(folder.get());
    if (entry == nullptr) break;
    const std::string name = entry->d_name;
    const bool is_type_known = entry->d_type != DT_UNKNOWN && entry->d_type != DT_LNK;
    std::error_code broken_link;  // stays in the list, so that reading it is an error
    const bool is_folder = is_type_known
                               ? entry->d_type == DT_DIR
                               : fs::is_directory(fs::path(directory) / name, broken_link);
    if (IsFrameName(name) && !is_folder) names.push_back(name);
    if (is_folder && name.front() != '.' && (subfolder.empty() || name < subfolder)) {
      subfolder = name;
    }
  }
  check(errno == 0);
  if (names.empty()) {
    throw InputError(directory + ": holds no .pcd file, expected at least one frame" +
                     (subfolder.empty() ? ""
                                        : "; a recording of several LiDARs has one --frames each, "
                                          "as --frames " +
                                              (fs::path(directory) / subfolder).string()));
  }
  std::sort(names.begin(), names.end());
  return names;
}

// Returns empty if the directory has no such file.
std::optional<StampsByFile> ReadStampFile(const std::string& directory,
                                          const std::vector<std::string>& names) {
  const std::string path = (fs::path(directory) / kStampFile).string();
  std::error_code error;
  const fs::file_status status = fs::symlink_status(path, error);
  if (status.type() == fs::file_type::not_found) return std::nullopt;
  if (error) {  // of the directory: unreadable files have a status
    throw InputError(directory + ": " + error.message() +
                     ", expected a directory whose files can be opened");
  }
  const std::string header = Quoted(kStampHeader);
  LineReader lines(path, {"the header " + header, true});
  const auto fail = [&](const std::string& what) {
    throw InputError(path + ":" + std::to_string(lines.number()) + ": " + what);
  };
  if (!lines.Next()) throw InputError(path + ": is empty, expected the header " + header);
  const std::string_view first = Trimmed(lines.line());
  if (first != kStampHeader) fail("the header is " + Quoted(first) + ", expected " + header);
  StampsByFile stamps;
  while (lines.Next()) {
    const std::string_view line = Trimmed(lines.line());
    if (line.empty()) continue;
    const std::size_t comma = line.rfind(',');
    if (comma == std::string_view::npos) {
      fail(Quoted(line) + " has one value, expected a file and its stamp");
    }
    const std::string name(Trimmed(line.substr(0, comma)));
    const std::string_view stamp = Trimmed(line.substr(comma + 1));
    const std::optional<TimeNs> stamp_ns = StampInRange(stamp);
    if (!stamp_ns) fail("the timestamp is " + Quoted(stamp) + ", " + kExpectedStamp);
    if (!std::binary_search(names.begin(), names.end(), name)) {
      fail(Quoted(name) + " is no frame in this directory, expected the name of a .pcd file in it");
    }
    if (!stamps.emplace(name, *stamp_ns).second) {
      fail(Quoted(name) + " is listed a second time, expected one stamp for each file");
    }
  }
  for (const std::string& name : names) {
    if (stamps.count(name) == 0) {
      fail("the last line, and no stamp for " + Quoted(name) +
           ", expected one for every .pcd file");
    }
  }
  return stamps;
}

}  // namespace

std::optional<TimeNs> StampInRange(std::string_view text) {
  const std::optional<TimeNs> stamp_ns = ParseStamp(text);
  if (!stamp_ns || *stamp_ns > kMaxStampNs || *stamp_ns < -kMaxStampNs) return std::nullopt;
  return stamp_ns;
}

bool IsFrameName(const std::string& name) {
  return name.size() > kFrameSuffix.size() && name.front() != '.' &&
         name.compare(name.size() - kFrameSuffix.size(), kFrameSuffix.size(), kFrameSuffix) == 0;
}

SensorConfig SensorConfigOf(const Config& config, const std::string& name) {
  const auto known = config.sensors.find(name);
  return known == config.sensors.end() ? SensorConfig() : known->second;
}

double FrameRateHz(const Config& config, const std::string& name) {
  const double rate_hz = SensorConfigOf(config, name).frame_rate_hz;
  return rate_hz > 0.0 ? rate_hz : config.input.frame_rate_hz;
}

void FrameClock::Settle(const std::vector<std::string_view>& names) {
  std::vector<std::uint64_t> numbers;
  bool are_whole = true;
  for (const std::string_view name : names) {
    if (!ParseStamp(name)) continue;
    const auto number = ParseNumber<std::uint64_t>(name);
    are_whole = are_whole && number;
    if (number) numbers.push_back(*number);
  }
  std::sort(numbers.begin(), numbers.end());
  std::vector<std::uint64_t> steps;
  const std::uint64_t step = numbers.size() < 2 ? 0 : MedianStep(numbers, &steps);
  if (numbers.empty() || !are_whole || !AreNumbers(numbers, step)) {
    SetStamps(numbers.empty() ? std::nullopt : std::make_optional(numbers.front()));
    return;
  }
  if (numbers.size() == 1) return;  // no difference to judge by: TimeOf() assumes frame numbers
  SetNumbers(step, std::to_string(numbers.front()) + " to " + std::to_string(numbers.back()) +
                       ", " + std::to_string(step) + " apart");
}

// `whole`: a name that may have been meant as a number, if any.
void FrameClock::SetStamps(std::optional<std::uint64_t> whole) {
  reading_ = Reading::kStamps;
  if (rate_hz_ <= 0.0 || !whole) return;
  warning_ = Warning{"frame_rate_unused",
                     source_ + ": frame_rate_hz is given, but names are stamps (" +
                         std::to_string(*whole) + "), not numbers of frames: it is not used"};
}

void FrameClock::SetNumbers(std::uint64_t step, const std::string& seen) {
  if (rate_hz_ > 0.0) {
    reading_ = Reading::kNumbers;
    return;
  }
  const auto* const unit = std::find_if(kUnits.begin(), kUnits.end(), [&](const NumberUnit& known) {
    return known.min_step <= step && step <= known.max_step;
  });
  if (unit == kUnits.end()) {
    throw InputError(source_ + ": names are whole numbers (" + seen +
                     "), neither numbers of frames nor times of a LiDAR, expected "
                     "input.frame_rate_hz: how many make a second");
  }
  reading_ = Reading::kNumbers;
  rate_hz_ = unit->rate_hz;
  warning_ = Warning{"numbered_frames", source_ + ": names are whole numbers (" + seen +
                                            "), no stamps: taken as " + unit->words +
                                            "; input.frame_rate_hz says how many make a second"};
}

std::optional<TimeNs> FrameClock::TimeOf(std::string_view name) {
  const auto number = ParseNumber<std::uint64_t>(name);
  if (reading_ == Reading::kUnsettled) {
    if (number && *number == 0) {
      last_number_ = 0;
      return 0;
    }
    if (!ParseStamp(name)) return std::nullopt;
    if (number && *number < kMinUnixS) {
      is_assumed_by_one_ = rate_hz_ <= 0.0 && !last_number_;
      SetNumbers(last_number_ ? *number : 0, std::to_string(*number) + " at first");
    } else {
      SetStamps(number);
    }
  }
  if (reading_ == Reading::kStamps) return StampInRange(name);
  if (!number) {
    if (!StampInRange(name)) return std::nullopt;
    throw InputError(source_ + ": " + Quoted(name) +
                     " is a stamp, but frames before are numbered (" +
                     std::to_string(last_number_.value_or(0)) + "), expected one or the other");
  }
  if (is_assumed_by_one_ && last_number_) {
    const auto [less, more] = std::minmax(*number, *last_number_);
    if (more - less > kUnits.front().max_step) {
      throw InputError(source_ + ": names are whole numbers, " + std::to_string(*number) +
                       " after " + std::to_string(*last_number_) +
                       ", expected input.frame_rate_hz: how many make a second (1000: "
                       "milliseconds)");
    }
    is_assumed_by_one_ = false;
  }
  last_number_ = number;
  return OfNumber(static_cast<double>(*number));
}

std::optional<TimeNs> FrameClock::OfNumber(double number) const {
  const double time_ns = number * 1e9 / rate_hz_;
  if (!(time_ns <= static_cast<double>(kMaxStampNs))) return std::nullopt;
  return static_cast<TimeNs>(std::floor(time_ns + 0.5));
}

std::vector<FrameFile> ListFrames(const std::string& directory, FrameClock* clock) {
  const std::vector<std::string> names = FrameNames(directory);
  const std::optional<StampsByFile> listed = ReadStampFile(directory, names);
  if (!listed) {
    std::vector<std::string_view> stems;
    stems.reserve(names.size());
    for (const std::string& name : names) stems.push_back(StemOf(name));
    clock->Settle(stems);
  }
  std::vector<FrameFile> frames;
  for (const std::string& name : names) {
    const std::string path = (fs::path(directory) / name).string();
    const std::optional<TimeNs> stamp_ns = listed ? listed->at(name) : clock->TimeOf(StemOf(name));
    if (!stamp_ns) {
      throw InputError(path + ": " + Quoted(StemOf(name)) + " is no stamp, " + kExpectedStamp +
                       ", a mere number such as 000123, or a row of timestamps.csv");
    }
    frames.push_back({path, *stamp_ns});
  }
  std::stable_sort(frames.begin(), frames.end(), By(&FrameFile::stamp_ns));
  for (std::size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].stamp_ns == frames[i - 1].stamp_ns) {
      throw InputError(frames[i].path + ": has the stamp " + std::to_string(frames[i].stamp_ns) +
                       " ns of " + frames[i - 1].path + ", expected one frame for each stamp");
    }
  }
  return frames;
}

}  // namespace unlidar
