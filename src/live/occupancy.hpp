// What a stream of frames says about every place at other times: structure, clutter or free space.
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

// Occupancy of places over a sliding window of time bins, as bits; what is older counts on, but
// fades. As Background says it of a recording, a return is judged by the bins outside the dwell of
// its place: by what came before, for a stream does not know what follows.
class Occupancy {
 public:
  struct Verdict {
    bool is_structure = false;  // or too little is known to tell
    bool floats = false;        // structure that nothing holds up
    float place_rate = 0.0F;    // as Background::PlaceRate
    std::optional<std::int64_t>
        dwell_begin_bin;  // in which the dwell of its place began, if it is known
  };

  // Whether a place floats in a scene, which is asked once for each place and scene.
  using FloatsIn = std::function<bool(const Eigen::Vector3f&)>;

  // Whether what has been at a place since a bin is a known target. None if empty.
  using IsTargetSince = std::function<bool(const Eigen::Vector3f&, std::int64_t bin)>;

  explicit Occupancy(const BackgroundConfig& config);

  // Bins count up; frames may come out of order by a few bins.
  void AddFrame(std::int64_t bin);
  void Add(const Eigen::Vector3f& point_m, std::int64_t bin);

  // Of a return that was measured in `bin`, which is in the window. `scene` numbers what `floats`
  // tells of.
  Verdict Judge(const Eigen::Vector3f& point_m, std::int64_t bin, int scene, const FloatsIn& floats,
                const IsTargetSince& is_target = nullptr);

  // As the place rate of a verdict, of what is about a place: the rate that most of the places next
  // to it surpass. Where the air is full, chance spares some places; that nothing was there yet
  // says less than that there was something all about it.
  double RateAbout(const Eigen::Vector3f& point_m, std::int64_t bin) const;

  // Sets a return of each place that was last judged to be structure and was hit within the window.
  void GetStructure(std::vector<Eigen::Vector3f>* points_m) const;

  // Likewise of each place that was hit at least half as often as structure, at several times
  // outside its dwell: what is seen seldom may hold things up as well. In the first seconds of each
  // that is hit until now.
  void GetSupporters(std::vector<Eigen::Vector3f>* points_m) const;

  // Forgets places that were not hit for the window, but for structure of old. Call it now and
  // then.
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
    Bits near;                   // and in its neighbourhood, by the time it was last asked for
    float older = 0.0F;          // hits in the voxel before the window, faded,
    float older_near = 0.0F;     // and in the neighbourhood
    float past_occupied = 0.0F;  // outside of the dwell when that began
    float past_exposed = 0.0F;
    bool is_dwell_long = false;  // it fills the window
    bool is_own = false;         // of the shell that its last return lies in
    bool is_structure = false;
    bool is_supporter = false;
    bool floats = false;
    int scene = -1;                  // of which that is true
    std::int64_t judged_until = -1;  // what is structure is not looked at anew before this bin
    Eigen::Vector3f point_m = Eigen::Vector3f::Zero();
  };

  // Hits in a neighbourhood.
  struct Hits {
    std::uint64_t word = 0;   // by bins before the newest
    float free_share = 1.0F;  // of the bins before the window
  };

  void Shift(Place* place) const;
  void Count(const Place& place, Hits* hits) const;
  Hits HitsAbout(const Eigen::Vector3f& point_m) const;
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
