// Folders into which frames are written at run time.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/descriptor.hpp"
#include "io/frame_directory.hpp"
#include "io/frames.hpp"
#include "unlidar/config.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

struct FollowedCounts {
  std::uint64_t vanished = 0;     // deleted before they were read
  std::uint64_t passed_over = 0;  // stamp seen before
  // Present at the first listing of their folder, up to `after_ns`.
  std::uint64_t already_processed = 0;
};

struct FollowedFrame {
  using Clock = std::chrono::steady_clock;

  std::uint32_t folder = 0;
  FrameFile file;  // named by its stamp
  // Time of discovery; empty for frames present when their folder was first listed.
  std::optional<Clock::time_point> arrived;
};

// Delivers the frames of several folders in order of stamp: those present, then those that appear
// by a rename or are closed by their writer. A folder may be empty or missing, and may be removed
// and created again: each Update() looks for it. A file open for writing waits until it is closed.
//
// At most kMaxPending frames are remembered; if there are more, or if the system lost events, the
// folders are listed again. A frame is delivered once: one whose stamp is among the last
// kMaxDelivered of its folder is skipped and counted. A frame found by listing is also skipped if
// it is no newer than the stamps delivered before those: it was already there. A frame reported by
// an event is new however old its stamp is, since the clock may have been set back.
class FollowedFolders {
 public:
  static constexpr std::size_t kMaxPending = std::size_t{1} << 13;
  static constexpr std::size_t kMaxDelivered = 1024;

  using BadFrameCallback = std::function<void(const InputError&)>;

  // The names present when a folder is first listed settle how all its names are read, see
  // FrameClock; for an empty folder, the first frame to appear does. Frames found by listing up to
  // `after_ns` (with their offset) are skipped, and counted the first time. Frames without a stamp
  // go to `on_bad_frame`. Throws InputError for a folder that cannot be watched and for a
  // timestamps.csv, here and later.
  FollowedFolders(const std::vector<FrameSource>& sources, const Config& config,
                  std::optional<TimeNs> after_ns, BadFrameCallback on_bad_frame);

  // Readable when events in the folders that are there are pending.
  int fd() const { return inotify_.get(); }

  // Processes pending events; never blocks.
  void Update();

  // Returns the earliest complete frame.
  std::optional<FollowedFrame> Next();

  // Those since the last call.
  std::vector<Warning> TakeWarnings() { return std::exchange(warnings_, {}); }

  std::size_t num_pending() const { return pending_.size(); }
  const FollowedCounts& counts() const { return counts_; }

  // Counts a delivered frame whose file had vanished.
  void NoteVanished() { ++counts_.vanished; }

 private:
  struct WatchedFolder {
    WatchedFolder(const FrameSource& source, const Config& config);

    std::string directory;  // absolute
    FrameClock clock;
    TimeNs offset_ns;  // added to its stamps to sort the frames of all folders
    int watch = -1;    // while it is there
    bool was_listed = false;
    TimeNs listed_ns = 0;             // Unix time of the first listing
    std::deque<TimeNs> delivered_ns;  // the last ones
    std::optional<TimeNs> newest_forgotten_ns;
  };
  struct Pending {
    std::string name;
    TimeNs stamp_ns = 0;
    bool is_listed = false;  // found by listing: it may still be open for writing
    std::optional<FollowedFrame::Clock::time_point> arrived;
  };
  using Order = std::pair<TimeNs, std::uint32_t>;  // stamp plus offset, folder

  void Attach();
  void List(std::uint32_t index);
  void ListAll();
  void TakeEvent(int watch, std::uint32_t mask, const std::string& name);
  void Settle(const std::vector<std::string>& names, WatchedFolder* folder);
  void Offer(std::uint32_t index, const std::string& name, bool is_listed);
  std::optional<TimeNs> StampOf(const std::string& name, bool is_listed, WatchedFolder* folder);
  static bool WasDelivered(const WatchedFolder& folder, TimeNs stamp_ns, bool is_listed);

  std::vector<WatchedFolder> folders_;
  std::optional<TimeNs> after_ns_;
  BadFrameCallback on_bad_frame_;
  Descriptor inotify_;
  std::map<Order, Pending> pending_;
  bool has_more_ = false;  // frames in the folders that pending_ has no room for
  std::optional<FollowedFrame::Clock::time_point> list_again_;
  FollowedCounts counts_;
  std::vector<Warning> warnings_;  // not yet taken
};

}  // namespace unlidar
