#include "tracking/rejection.hpp"

#include <stdexcept>

namespace unlidar {

const char* NameOf(Rejection rejection) {
  switch (rejection) {
    case Rejection::kNone:
      return "";
    case Rejection::kStructure:
      return "structure";
    case Rejection::kBody:
      return "body";
    case Rejection::kWarmUp:
      return "warm_up";
    case Rejection::kSurge:
      return "surge";
    case Rejection::kBelowThreshold:
      return "below_threshold";
    case Rejection::kPause:
      return "pause";
    case Rejection::kTooFewDetections:
      return "too_few_detections";
    case Rejection::kNearGround:
      return "near_ground";
    case Rejection::kStationary:
      return "stationary";
    case Rejection::kWeakReturn:
      return "weak_return";
    case Rejection::kCrowded:
      return "crowded";
    case Rejection::kPartOfAnotherTrack:
      return "part_of_another_track";
    case Rejection::kSharesReturns:
      return "shares_returns";
    case Rejection::kSingleMeasurement:
      return "single_measurement";
    case Rejection::kSuspended:
      return "suspended";
    case Rejection::kCloud:
      return "cloud";
    case Rejection::kInsect:
      return "insect";
    case Rejection::kLost:
      return "lost";
  }
  throw std::logic_error("a rejection without a name");
}

}  // namespace unlidar
