#include "tracking/rejection.hpp"

#include <stdexcept>

namespace unlidar {

const char* NameOf(Rejection rejection) {
  switch (rejection) {
    case Rejection::kNone:
      return "";
    case Rejection::kBelowThreshold:
      return "below_threshold";
    case Rejection::kTooFewDetections:
      return "too_few_detections";
    case Rejection::kNearGround:
      return "near_ground";
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
    case Rejection::kClutterReturns:
      return "clutter_returns";
    case Rejection::kCloud:
      return "cloud";
    case Rejection::kInsect:
      return "insect";
  }
  throw std::logic_error("a rejection without a name");
}

}  // namespace unlidar
