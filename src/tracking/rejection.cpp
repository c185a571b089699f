#include "tracking/rejection.hpp"

#include <array>
#include <cstddef>

namespace unlidar {

const char* NameOf(Rejection rejection) {
  constexpr std::array kNames = {"",
                                 "structure",
                                 "body",
                                 "warm_up",
                                 "surge",
                                 "below_threshold",
                                 "pause",
                                 "too_few_detections",
                                 "near_ground",
                                 "stationary",
                                 "weak_return",
                                 "crowded",
                                 "part_of_another_track",
                                 "shares_returns",
                                 "single_measurement",
                                 "suspended",
                                 "cloud",
                                 "insect",
                                 "lost"};
  static_assert(kNames.size() == static_cast<std::size_t>(Rejection::kLost) + 1);
  return kNames[static_cast<std::size_t>(rejection)];
}

}  // namespace unlidar
