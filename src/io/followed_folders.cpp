#include "io/followed_folders.hpp"

#include <fcntl.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "base/algorithms.hpp"
#include "base/recording.hpp"
#include "io/arrival.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

using Clock = FollowedFrame::Clock;

constexpr std::uint32_t kMask = IN_CLOSE_WRITE | IN_MOVED_TO | IN_MOVE_SELF | IN_ONLYDIR;

// If the system cannot report open writers, a file changed within this time counts as open.
constexpr std::chrono::seconds kSettleTime(1);

enum class FileState { kComplete, kBeingWritten, kUnsettled, kGone };

struct File {
  FileState state = FileState::kComplete;
  TimeNs changed_ns = 0;  // Unix time of its last write or rename; 0 if unknown
};

// A read lease is granted only if nobody has the file open for writing.
File FileAt(const std::string& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (!file.is_open()) return {errno == ENOENT ? FileState::kGone : FileState::kComplete, 0};
  struct stat status {};
  const bool is_known = ::fstat(file.get(), &status) == 0;
  FileState state = FileState::kComplete;
  if (::fcntl(file.get(), F_SETLEASE, F_RDLCK) == 0) {
    ::fcntl(file.get(), F_SETLEASE, F_UNLCK);
  } else if (errno == EAGAIN) {
    state = FileState::kBeingWritten;
  } else {  // another user's file, or a file system without leases
    const bool is_recent = is_known && std::time(nullptr) - status.st_mtime <= kSettleTime.count();
    if (is_recent) state = FileState::kUnsettled;
  }
  return {state, TimeNs{status.st_ctim.tv_sec} * kNsPerSecond + status.st_ctim.tv_nsec};
}

[[noreturn]] void FailToWatch(const std::string& path, int error) {
  const std::string reason = error == ENOSPC
                                 ? "no more watches are allowed, see fs.inotify.max_user_watches"
                                 : std::strerror(error);
  throw InputError(path + ": cannot be followed (" + reason + "), expected a folder");
}

}  // namespace

FollowedFolders::WatchedFolder::WatchedFolder(const FrameSource& source, const Config& config)
    : directory(fs::absolute(source.directory).lexically_normal().string()),
      clock(source.directory, FrameRateHz(config, SourceName(source))),
      offset_ns(NsOf(SensorConfigOf(config, SourceName(source)).time_offset_s)) {}

FollowedFolders::FollowedFolders(const std::vector<FrameSource>& sources, const Config& config,
                                 std::optional<TimeNs> after_ns, BadFrameCallback on_bad_frame)
    : after_ns_(after_ns),
      on_bad_frame_(std::move(on_bad_frame)),
      inotify_(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC)) {
  if (!inotify_.is_open())
    throw std::runtime_error(std::string("inotify: ") + std::strerror(errno));
  for (const FrameSource& source : sources) folders_.emplace_back(source, config);
  Attach();
}

void FollowedFolders::Update() {
  alignas(inotify_event) std::array<char, 1 << 16> buffer{};
  bool has_lost_events = false;
  while (true) {
    const ssize_t got =
        Uninterrupted([&] { return ::read(inotify_.get(), buffer.data(), buffer.size()); });
    if (got <= 0) break;
    for (std::size_t at = 0; at < static_cast<std::size_t>(got);) {
      const auto event = LoadAs<inotify_event>(buffer.data() + at);
      const char* name = buffer.data() + at + sizeof(event);
      at += sizeof(event) + event.len;
      if ((event.mask & IN_Q_OVERFLOW) != 0) {
        has_lost_events = true;
      } else {
        TakeEvent(event.wd, event.mask, event.len > 0 ? name : "");
      }
    }
  }
  Attach();
  const bool is_due = list_again_ && Clock::now() >= *list_again_;
  if (has_lost_events || is_due) ListAll();
}

std::optional<FollowedFrame> FollowedFolders::Next() {
  if (pending_.empty() && has_more_) ListAll();
  while (!pending_.empty()) {
    const auto node = pending_.extract(pending_.begin());
    const std::uint32_t index = node.key().second;
    const Pending& next = node.mapped();
    WatchedFolder& folder = folders_[index];
    const std::string path = (fs::path(folder.directory) / next.name).string();
    const File file = FileAt(path);
    if (file.state == FileState::kGone) {
      ++counts_.vanished;
      continue;
    }
    // Offered again when its writer closes it.
    if (file.state == FileState::kBeingWritten) continue;
    if (file.state == FileState::kUnsettled && next.is_listed) {
      if (!list_again_) list_again_ = Clock::now() + kSettleTime;
      continue;
    }
    folder.delivered_ns.push_back(next.stamp_ns);
    if (folder.delivered_ns.size() > kMaxDelivered) {
      const TimeNs forgotten_ns = folder.delivered_ns.front();
      folder.delivered_ns.pop_front();
      folder.newest_forgotten_ns =
          std::max(folder.newest_forgotten_ns.value_or(forgotten_ns), forgotten_ns);
    }
    const bool was_there = next.is_listed && file.changed_ns <= folder.listed_ns;
    return FollowedFrame{index, {path, next.stamp_ns}, was_there ? std::nullopt : next.arrived};
  }
  return std::nullopt;
}

// Watches and lists the folders that are not watched, unless they are missing.
void FollowedFolders::Attach() {
  for (std::uint32_t i = 0; i < folders_.size(); ++i) {
    WatchedFolder& folder = folders_[i];
    if (folder.watch >= 0) continue;
    folder.watch = ::inotify_add_watch(inotify_.get(), folder.directory.c_str(), kMask);
    if (folder.watch >= 0) {
      List(i);
    } else if (errno != ENOENT) {
      FailToWatch(folder.directory, errno);
    }
  }
}

void FollowedFolders::List(std::uint32_t index) {
  const std::string directory = folders_[index].directory;
  if (!folders_[index].was_listed)
    folders_[index].listed_ns = NsSinceEpoch(std::chrono::system_clock::now());
  std::vector<std::string> names;
  std::error_code error;
  fs::directory_iterator entry(directory, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    std::error_code ignored;
    if (entry->is_directory(ignored)) continue;
    names.push_back(entry->path().filename().string());
  }
  Settle(names, &folders_[index]);
  for (const std::string& name : names) Offer(index, name, true);
  // The removal of a folder causes an event.
  if (error && error.value() != ENOENT) FailToWatch(directory, error.value());
  folders_[index].was_listed = true;
}

void FollowedFolders::ListAll() {
  has_more_ = false;
  list_again_.reset();
  for (std::uint32_t i = 0; i < folders_.size(); ++i) {
    if (folders_[i].watch >= 0) List(i);
  }
}

void FollowedFolders::TakeEvent(int watch, std::uint32_t mask, const std::string& name) {
  for (std::uint32_t i = 0; i < folders_.size(); ++i) {
    if (folders_[i].watch != watch) continue;
    if ((mask & (IN_IGNORED | IN_MOVE_SELF)) != 0) {
      ::inotify_rm_watch(inotify_.get(), watch);  // another folder may take its place
      folders_[i].watch = -1;
    } else if ((mask & (IN_CLOSE_WRITE | IN_MOVED_TO)) != 0 && (mask & IN_ISDIR) == 0) {
      Offer(i, name, false);
    }
  }
}

void FollowedFolders::Settle(const std::vector<std::string>& names, WatchedFolder* folder) {
  if (folder->clock.is_settled()) return;
  std::vector<std::string_view> stems;
  for (const std::string& name : names) {
    if (IsFrameName(name) && StampInRange(StemOf(name))) stems.push_back(StemOf(name));
  }
  if (stems.empty()) return;
  folder->clock.Settle(stems);
  if (auto warning = folder->clock.TakeWarning()) warnings_.push_back(std::move(*warning));
}

// Returns empty for a name that is not a stamp, which is reported once.
std::optional<TimeNs> FollowedFolders::StampOf(const std::string& name, bool is_listed,
                                               WatchedFolder* folder) {
  try {
    const std::optional<TimeNs> stamp_ns = folder->clock.TimeOf(StemOf(name));
    if (auto warning = folder->clock.TakeWarning()) warnings_.push_back(std::move(*warning));
    if (stamp_ns) return stamp_ns;
    throw InputError((fs::path(folder->directory) / name).string() + ": '" +
                     std::string(StemOf(name)) + "' is no stamp, " + kExpectedStamp);
  } catch (const InputError& error) {
    const bool was_reported = is_listed && folder->was_listed;
    if (!was_reported) on_bad_frame_(error);
    return std::nullopt;
  }
}

void FollowedFolders::Offer(std::uint32_t index, const std::string& name, bool is_listed) {
  WatchedFolder& folder = folders_[index];
  if (name == kStampFile) {
    throw InputError((fs::path(folder.directory) / name).string() +
                     ": cannot be followed, expected frames whose names are their stamps");
  }
  if (!IsFrameName(name)) return;
  const std::optional<TimeNs> stamp_ns = StampOf(name, is_listed, &folder);
  if (!stamp_ns) return;
  const TimeNs common_ns = *stamp_ns + folder.offset_ns;
  if (is_listed && after_ns_ && common_ns <= *after_ns_) {  // an earlier run has processed it
    if (!folder.was_listed) ++counts_.already_processed;
    return;
  }
  if (WasDelivered(folder, *stamp_ns, is_listed)) {
    if (!is_listed) ++counts_.passed_over;
    return;
  }
  const Order order = {common_ns, index};
  // No frame may overtake those dropped for lack of room.
  if (has_more_ && (pending_.empty() || pending_.rbegin()->first < order)) return;
  Pending pending{name, *stamp_ns, is_listed, Clock::now()};
  const auto [place, is_new] = pending_.try_emplace(order, pending);
  if (!is_new) {
    place->second.is_listed = place->second.is_listed && is_listed;
    if (place->second.name != name) ++counts_.passed_over;
  }
  if (pending_.size() > kMaxPending) {
    pending_.erase(std::prev(pending_.end()));
    has_more_ = true;
  }
}

bool FollowedFolders::WasDelivered(const WatchedFolder& folder, TimeNs stamp_ns, bool is_listed) {
  const bool is_old = folder.newest_forgotten_ns && stamp_ns <= *folder.newest_forgotten_ns;
  const auto& delivered_ns = folder.delivered_ns;
  return (is_listed && is_old) ||
         std::find(delivered_ns.begin(), delivered_ns.end(), stamp_ns) != delivered_ns.end();
}

}  // namespace unlidar
