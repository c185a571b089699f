// Folders into which frames are written while the program runs.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "io/frame_directory.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

// What became of frames that were not given.
struct FollowedCounts {
  std::uint64_t vanished = 0;     // gone before they were read
  std::uint64_t passed_over = 0;  // their stamp had come before
  std::uint64_t already_processed =
      0;  // there when their folder was first listed, up to `after_ns`
};

struct FollowedFrame {
  using Clock = std::chrono::steady_clock;

  std::size_t folder = 0;
  FrameFile file;  // its stamp is its name
  // When it was seen; empty for one that was there when its folder was first listed.
  std::optional<Clock::time_point> arrived;
};

// The frames of some folders in the order of their stamps: those that are there, then those that
// appear by a rename or are closed by their writer. A folder may be empty or absent, and may be
// removed and come back. A file that is open for writing waits until it is closed.
//
// At most kMaxPending frames are remembered: for more, and where the system lost count, the folders
// are listed again. A frame is given once: one whose stamp is among the last kMaxDelivered that its
// folder gave is passed over and counted. One that is found by listing is also passed over where it
// is no newer than those before: it was there already. One that appears is new, however old its
// stamp is, as the clock may have gone back.
class FollowedFolders {
 public:
  static constexpr std::size_t kMaxPending = std::size_t{1} << 13;
  static constexpr std::size_t kMaxDelivered = 1024;

  struct Folder {
    std::string directory;
    TimeNs offset_ns = 0;  // from its stamps to the time by which frames of all folders are sorted
    double frame_rate_hz = 0.0;  // as of FrameClock
  };
  using BadFrameCallback = std::function<void(const InputError&)>;

  // The names that are there when a folder is first listed settle how all are read, see FrameClock;
  // of an empty folder the first one that appears. Frames up to `after_ns` (with their offset) that
  // are found by listing are passed over, and counted the first time. A frame without a stamp goes
  // to `on_bad_frame`. Throws InputError for what cannot be watched and for a timestamps.csv, here
  // and later.
  FollowedFolders(const std::vector<Folder>& folders, std::optional<TimeNs> after_ns,
                  BadFrameCallback on_bad_frame);
  ~FollowedFolders();
  FollowedFolders(const FollowedFolders&) = delete;
  FollowedFolders& operator=(const FollowedFolders&) = delete;

  // Ready to read when something has happened.
  int fd() const { return fd_; }

  // Takes in what has happened, never waits.
  void Update();

  // The earliest frame that is complete.
  std::optional<FollowedFrame> Next();

  // What is newly in doubt about the names.
  std::vector<Warning> TakeWarnings() { return std::exchange(warnings_, {}); }

  std::size_t num_pending() const { return pending_.size(); }
  const FollowedCounts& counts() const { return counts_; }

  // A frame that was given, but had gone.
  void NoteVanished() { ++counts_.vanished; }

 private:
  struct WatchedFolder {
    explicit WatchedFolder(const Folder& folder);

    std::string directory;  // absolute
    FrameClock clock;
    TimeNs offset_ns = 0;
    int watch = -1;           // of the folder, or
    int ancestor_watch = -1;  // of the nearest folder above that exists
    bool was_listed = false;
    TimeNs listed_ns = 0;  // Unix time of the first time
    std::set<TimeNs> delivered_ns;
    std::deque<TimeNs> delivered_in_order_ns;
    std::optional<TimeNs> newest_forgotten_ns;
  };
  struct Pending {
    std::string name;
    TimeNs stamp_ns = 0;
    bool is_listed = false;  // not by an event: its writer may still be at it
    std::optional<FollowedFrame::Clock::time_point> arrived;
  };
  using Order = std::pair<TimeNs, std::size_t>;  // stamp with its offset, folder

  void Attach(std::size_t index);
  void Detach(std::size_t index);
  void Release(int watch);
  int AddWatch(const std::string& path, std::uint32_t mask) const;
  void List(std::size_t index);
  void ListAll();
  void TakeEvent(int watch, std::uint32_t mask, const std::string& name);
  void Settle(const std::vector<std::string>& names, WatchedFolder* folder);
  void Offer(std::size_t index, const std::string& name, bool is_listed);
  std::optional<TimeNs> StampOf(const std::string& name, bool is_listed, WatchedFolder* folder);
  bool WasProcessed(const WatchedFolder& folder, TimeNs stamp_ns) const;
  static bool WasDelivered(const WatchedFolder& folder, TimeNs stamp_ns, bool is_listed);
  static void MarkDelivered(TimeNs stamp_ns, WatchedFolder& folder);

  std::vector<WatchedFolder> folders_;
  std::optional<TimeNs> after_ns_;
  BadFrameCallback on_bad_frame_;
  int fd_ = -1;
  std::map<Order, Pending> pending_;
  bool has_more_ = false;  // frames in the folders that pending_ has no room for
  std::optional<FollowedFrame::Clock::time_point> list_again_;
  FollowedCounts counts_;
  std::vector<Warning> warnings_;  // not taken yet
};

}  // namespace unlidar
