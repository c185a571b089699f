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

struct FollowedFrame {
  using Clock = std::chrono::steady_clock;

  std::size_t folder = 0;
  FrameFile file;  // its stamp is its name
  // When it was seen; empty for one that was there when its folder was first listed, or is no newer
  // than such a one.
  std::optional<Clock::time_point> came;
};

// The frames of some folders in the order of their stamps: those that are there, then those that
// appear by a rename or are closed by their writer. A folder may be empty or absent, and may be
// removed and come back. A file that is open for writing waits until it is closed.
//
// At most kMaxPending frames are remembered: for more, and where the system lost count, the folders
// are listed again. A frame is given once: one whose stamp is among the last kMaxGiven that its
// folder gave is passed over and counted. One that is found by listing is also passed over where it
// is no newer than those before: it was there already. One that appears is new, however old its
// stamp is, as the clock may have gone back.
class FollowedFolders {
 public:
  static constexpr std::size_t kMaxPending = std::size_t{1} << 13;
  static constexpr std::size_t kMaxGiven = 1024;

  struct Folder {
    std::string directory;
    TimeNs offset_ns = 0;  // from its stamps to the time by which frames of all folders are sorted
  };
  using BadFrameCallback = std::function<void(const InputError&)>;

  // Frames up to `after_ns` (with their offset) that are found by listing are passed over. A frame
  // without a stamp goes to `on_bad_frame`. Throws InputError for what cannot be watched and for a
  // timestamps.csv, here and later.
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

  std::size_t num_pending() const { return pending_.size(); }
  std::uint64_t num_vanished() const { return num_vanished_; }        // gone before they were read
  std::uint64_t num_passed_over() const { return num_passed_over_; }  // see above

  // A frame that was given, but had gone.
  void NoteVanished() { ++num_vanished_; }

 private:
  struct Watched {
    std::string directory;  // absolute
    TimeNs offset_ns = 0;
    int watch = -1;           // of the folder, or
    int ancestor_watch = -1;  // of the nearest folder above that exists
    bool was_listed = false;
    std::set<TimeNs> given_ns;
    std::deque<TimeNs> given_in_order_ns;
    std::optional<TimeNs> newest_forgotten_ns;
  };
  struct Pending {
    std::string name;
    TimeNs stamp_ns = 0;
    bool is_listed = false;  // not by an event: its writer may still be at it
    std::optional<FollowedFrame::Clock::time_point> came;
  };
  using Order = std::pair<TimeNs, std::size_t>;  // stamp with its offset, folder

  void Attach(std::size_t index);
  void Detach(std::size_t index);
  void Release(int watch);
  int AddWatch(const std::string& path, std::uint32_t mask) const;
  void List(std::size_t index);
  void ListAll();
  void TakeEvent(int watch, std::uint32_t mask, const std::string& name);
  void Offer(std::size_t index, const std::string& name, bool is_listed);
  bool WasGiven(const Watched& folder, TimeNs stamp_ns, bool is_listed) const;
  static void NoteGiven(TimeNs stamp_ns, Watched& folder);

  std::vector<Watched> folders_;
  std::optional<TimeNs> after_ns_;
  BadFrameCallback on_bad_frame_;
  int fd_ = -1;
  std::map<Order, Pending> pending_;
  bool has_more_ = false;                 // frames in the folders that pending_ has no room for
  std::optional<TimeNs> backlog_end_ns_;  // the newest frame that was there at the beginning
  std::optional<FollowedFrame::Clock::time_point> list_again_;
  std::uint64_t num_vanished_ = 0;
  std::uint64_t num_passed_over_ = 0;
};

}  // namespace unlidar
