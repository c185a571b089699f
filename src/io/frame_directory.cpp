#include "io/frame_directory.hpp"

#include <dirent.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <map>
#include <memory>
#include <new>
#include <system_error>

#include "base/format.hpp"
#include "base/recording.hpp"
#include "io/input_file.hpp"
#include "io/stamp.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kStampHeader = "file,timestamp";

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

std::string_view StemOf(std::string_view name) {
  return name.substr(0, name.size() - kFrameSuffix.size());
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
