#include "io/livox_sync.hpp"

#include <array>
#include <cstddef>
#include <cstdlib>

#include "base/recording.hpp"

namespace unlidar {
namespace {

constexpr int kSecondsToSynchronise = 10;

}  // namespace

const char* SyncStateName(SyncState state) {
  constexpr std::array kNames = {"synchronised", "lost", "unsynchronised"};
  return kNames[static_cast<std::size_t>(state)];
}

void LivoxSync::Take(LivoxClock clock, TimeNs time_ns) {
  const bool is_synchronised = clock == LivoxClock::kSynchronised;
  if (!state_) state_ = is_synchronised ? SyncState::kSynchronised : SyncState::kUnsynchronised;
  // A clock that is set begins a second anew, in either direction.
  if (begin_ns_ && std::abs(time_ns - *begin_ns_) >= kNsPerSecond) {
    Judge(synchronised_ > free_);
    begin_ns_.reset();
  }
  if (!begin_ns_) {
    begin_ns_ = time_ns;
    synchronised_ = free_ = 0;
  }
  ++(is_synchronised ? synchronised_ : free_);
}

void LivoxSync::Judge(bool is_synchronised) {
  synchronised_in_a_row_ = is_synchronised ? synchronised_in_a_row_ + 1 : 0;
  if (!is_synchronised && state_ == SyncState::kSynchronised) {
    state_ = SyncState::kLost;
    ++losses_;
  } else if (synchronised_in_a_row_ >= kSecondsToSynchronise) {
    state_ = SyncState::kSynchronised;
  }
}

}  // namespace unlidar
