// Time synchronisation of one Livox sensor, by what its packets say.
#pragma once

#include <cstdint>
#include <optional>

#include "io/livox_packets.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

enum class SyncState { kSynchronised, kLost, kUnsynchronised };  // kUnsynchronised: never was

const char* SyncStateName(SyncState state);

// A second in which most packets count from power-on ends the synchronisation, ten in a row in
// which most do not begin it: one that comes and goes is lost, and says so once in eleven seconds
// at most; a minority of packets, also of forged ones, tells nothing.
class LivoxSync {
 public:
  // Takes the clock and the time of a packet that is not astray.
  void Take(LivoxClock clock, TimeNs time_ns);

  // Empty before the first packet.
  std::optional<SyncState> state() const { return state_; }

  std::uint64_t losses() const { return losses_; }

 private:
  void Judge(bool is_synchronised);

  std::optional<SyncState> state_;
  std::uint64_t losses_ = 0;
  std::optional<TimeNs> begin_ns_;  // of the present second, and its packets so far
  std::uint64_t synchronised_ = 0;
  std::uint64_t free_ = 0;
  int synchronised_in_a_row_ = 0;  // seconds
};

}  // namespace unlidar
