// Whether z points up, by the scene itself.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "scene/ground.hpp"
#include "unlidar/types.hpp"

namespace unlidar {

// Ground is the one large plane that everything else stands on, and nothing hangs from: with z up,
// the lowest returns of many columns lie on it, and other returns above it. So each of 26
// directions, 45 degrees apart, is tried as up, with the returns of the first seconds of one
// sensor. z is not up where another one has far more ground, with things on it, unless a flat floor
// lies below: of a hall more is seen of the ceiling, and nothing tells it from a floor but that. A
// sensor that looks at the sky alone, or at a wall, tells nothing, nor does one that leans by less
// than about 30 degrees, or one in a hall that is turned.
//
// One direction is tried with each frame, so that none takes long.
class UpDirection {
 public:
  UpDirection();

  // A frame: its returns, and where the sensor stands.
  void AddFrame(TimeNs time_ns, const Eigen::Vector3f* begin_m, const Eigen::Vector3f* end_m,
                const Eigen::Vector3f& origin_m);

  // No frame will follow: tries what is left.
  void Finish();

  // A unit vector that is up, where z is not.
  const std::optional<Eigen::Vector3f>& found() const { return found_; }

 private:
  bool IsDone() const { return next_ > directions_.size(); }
  // That a direction is up.
  struct Evidence {
    double cells = 0.0;              // of ground, far ones by the inverse square of their distance
    double ground = 0.0;             // the same, by the share of the returns on it, not below
    bool has_objects_above = false;  // stand on it
  };

  Evidence EvidenceOf(const Eigen::Vector3f& up);
  bool HasFloor();
  void TryNext();

  std::vector<Eigen::Vector3f> directions_;  // z first
  std::vector<Eigen::Vector3f> points_m_;    // from the sensor
  std::vector<Eigen::Vector3f> rotated_m_;
  Ground ground_;
  Ground::Workspace workspace_;
  std::optional<TimeNs> begin_ns_;  // of the first frame with a return
  std::size_t next_ = 0;            // direction to try, and one more when all is said
  Evidence z_;
  Evidence best_;  // of the others
  Eigen::Vector3f best_up_ = Eigen::Vector3f::UnitZ();
  std::optional<Eigen::Vector3f> found_;
};

}  // namespace unlidar
