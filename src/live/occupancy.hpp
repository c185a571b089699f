// Occupancy of each place of a stream at other times: structure, clutter or free space.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "scene/background.hpp"
#include "scene/shell_table.hpp"

namespace unlidar {

// Occupancy over a sliding window of time bins, as bits; older bins are counts that fade. Same
// as Background of a recording, but a return is judged by the bins before the dwell of its place,
// because later ones are not yet known.
class Occupancy {
 public:
  struct Verdict {
    bool is_structure = false;                    // also where too few bins are exposed
    bool floats = false;                          // unsupported structure
    float place_rate = 0.0F;                      // same as Background::PlaceRate
    std::optional<std::int64_t> dwell_begin_bin;  // first bin of the dwell, if known
  };

  // True if a place is unsupported. Called once for each place and scene.
  using FloatsIn = std::function<bool(const Eigen::Vector3f&)>;

  // True if a known target has been at a place since a bin. May be empty: no targets.
  using IsTargetSince = std::function<bool(const Eigen::Vector3f&, std::int64_t bin)>;

  explicit Occupancy(const BackgroundConfig& config);

  // Bins count up; frames may come out of order by a few bins.
  void AddFrame(std::int64_t bin);
  void Add(const Eigen::Vector3f& point_m, std::int64_t bin);

  // Judges a return measured in `bin`; outside the window it is structure. `scene`: number of the
  // scene that `floats` refers to.
  Verdict Judge(const Eigen::Vector3f& point_m, std::int64_t bin, int scene, const FloatsIn& floats,
                const IsTargetSince& is_target = nullptr);

  // Returns the rate of returns around a place, in returns per frame and m^3: the rate that most
  // adjacent places exceed. In dense rain some places are empty by chance, so the surroundings say
  // more than the place itself.
  double RateAround(const Eigen::Vector3f& point_m, std::int64_t bin) const;

  // Sets one return for each place last judged as structure and hit within the window.
  void GetStructure(std::vector<Eigen::Vector3f>* points_m) const;

  // Sets one return for each possible support: a place hit at least half as often as structure, in
  // several bins outside its dwell; in the first seconds, any place that is still being hit.
  void GetSupporters(std::vector<Eigen::Vector3f>* points_m) const;

  // Erases places without hits in the window, except old structure. To be called periodically.
  void Sweep();

 private:
  static constexpr int kWindow = 64;  // bins

  // Bit i stands for i bins before `bin`.
  struct Bits {
    std::uint64_t word = 0;
    std::int64_t bin = 0;
  };

  struct Place {
    Bits own;                    // hits in the voxel
    Bits near;                   // and in its neighbourhood, when last updated
    float older = 0.0F;          // hits in the voxel before the window, faded,
    float older_near = 0.0F;     // and in the neighbourhood
    float past_occupied = 0.0F;  // bins outside the dwell when it began
    float past_exposed = 0.0F;
    bool is_dwell_long = false;  // the dwell fills the window
    bool is_own = false;         // its last return lies in this shell
    bool is_structure = false;
    bool is_supporter = false;
    bool floats = false;
    int scene = -1;                  // to which `floats` refers
    std::int64_t judged_until = -1;  // structure is not judged again before this bin
    Eigen::Vector3f point_m = Eigen::Vector3f::Zero();
  };

  // Hits in a neighbourhood.
  struct Hits {
    std::uint64_t word = 0;   // bit i: i bins before the newest
    float free_share = 1.0F;  // of the bins before the window
  };

  void Shift(Place* place) const;
  void Count(const Place& place, Hits* hits) const;
  Hits HitsAround(const Eigen::Vector3f& point_m) const;
  float OlderOf(const Hits& hits) const;
  double RateOf(float occupied, float exposed, const Eigen::Vector3f& point_m) const;
  template <class IsWanted>
  void GetReturnsOf(const IsWanted& is_wanted, std::vector<Eigen::Vector3f>* points_m) const;
  void UpdateNeighbourhood(const Eigen::Vector3f& point_m, Place* place);

  BackgroundConfig config_;
  int max_break_;
  std::int64_t newest_ = 0;
  std::uint64_t observed_bins_ = 0;   // bit i: any frame i bins before the newest
  double older_observed_bins_ = 0.0;  // before the window, faded
  double frames_ = 0.0;               // all, faded
  double bins_with_frames_ = 0.0;     // likewise
  ShellTable<Place> places_;
};

}  // namespace unlidar
