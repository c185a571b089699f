// Occupancy of each place at other times: structure, clutter or free space. method.md section 1.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "scene/occlusion.hpp"
#include "scene/recent_bins.hpp"
#include "scene/shell_table.hpp"
#include "unlidar/config.hpp"

namespace unlidar {

// Rate of strays, in returns per frame and m^3, from which one is within 1 m of any place at most
// times: there, a single return carries no evidence.
inline constexpr double kMaxStrayRate = 0.2;

// Strays may explain the returns of a place if their rate exceeds this share of its own.
inline constexpr double kMinStrayShare = 0.5;

// A frame of more returns takes so long that what may wait is left to the next ones.
inline constexpr std::size_t kManyReturns = 50'000;

// Rate of strays, in returns per frame and m^3.
struct StrayRate {
  double usual = 0.0;    // over all times
  double present = 0.0;  // of late
};

// Occupancy over the last RecentBins::kWindow time bins: of a recording all, searched window by
// window, of a stream those of a sliding window. A return is judged by the bins outside the dwell
// of its place, before and after it as far as they are known, in which the place was not hidden.
class Occupancy {
 public:
  struct Verdict {
    bool is_structure = false;                    // also where too few bins are exposed
    bool floats = false;                          // unsupported structure
    float place_rate = 0.0F;                      // see PlaceRate in method.md (3); 0 of structure
    float stray_rate = 0.0F;                      // of structure that strays explain; otherwise 0
    std::optional<std::int32_t> dwell_begin_bin;  // first bin of the dwell, if known
  };

  // True if a place is unsupported. Called at most once for each place and scene.
  using FloatsIn = std::function<bool(const Eigen::Vector3f&)>;

  // True if a known target has been at a place since a bin. May be empty: no targets.
  using IsTargetSince = std::function<bool(const Eigen::Vector3f&, std::int64_t bin)>;

  // `knows_strays`: UsualStrayRate() is estimated, otherwise it is 0.
  explicit Occupancy(const BackgroundConfig& config, bool knows_strays = true);

  // Adds a frame. Bins count up; frames may come out of order by a few bins. Sets `voxels`, if any,
  // for Judge().
  void AddFrame(PointsView points_m, std::int64_t bin, const CarrierPose& carrier = {},
                OwnVoxels* voxels = nullptr);

  // Judges each return measured in `bin`; outside the window it is structure. `voxels`: those of
  // AddFrame(), which need not be looked up then, or none. `scene`: number of the scene that
  // `floats` refers to.
  void Judge(PointsView points_m, std::int64_t bin, const OwnVoxels& voxels, int scene,
             const FloatsIn& floats, const IsTargetSince& is_target,
             std::vector<Verdict>* verdicts);

  // Judges the last return of every place, for GetStructure() and GetSupporters().
  void JudgeAll();

  // Returns the rate of returns per m^3 and frame at a place in the bins outside [first, last), as
  // if each bin with returns had equally many, with half a return where there was none; negative if
  // these bins are less than the share BackgroundConfig::min_exposure of all. Returns are counted
  // from the beginning.
  double RateOutside(const Eigen::Vector3f& place_m, std::int64_t first, std::int64_t last) const;

  // Returns the rate of returns around a place, in returns per frame and m^3: the rate that most
  // adjacent places exceed, but no less than `least_rate`. In dense rain some places are empty by
  // chance, so the surroundings say more than the place itself.
  double RateAround(const Eigen::Vector3f& point_m, std::int64_t bin,
                    double least_rate = 0.0) const;

  // Returns the rate of strays before a place, in returns per frame and m^3: what rain, snow, fog
  // and the sun return, they return all the way, the denser the nearer; before what stands in clear
  // air nothing returns. The lowest of the rates of places on the way.
  double UsualStrayRate(const Eigen::Vector3f& point_m) const;

  // Returns that and the rate in a bin and the one before it: strays come in squalls.
  StrayRate StrayRateIn(const Eigen::Vector3f& point_m, std::int64_t bin) const;

  // Sets one return for each place last judged as structure and hit within the window.
  void GetStructure(std::vector<Eigen::Vector3f>* points_m) const;

  // Sets one return for each possible support: structure and places hit at least half as often, in
  // several bins outside their dwells; in the first seconds, any that are still being hit; and
  // whether it lasts, as seen at other times or most of the time. The others may be places where a
  // target was.
  void GetSupporters(std::vector<Eigen::Vector3f>* points_m, std::vector<char>* are_lasting) const;

  const FieldOfView& field_of_view() const { return occlusion_.field_of_view(); }

  // Erases places without hits in the window. To be called periodically.
  void Sweep();

 private:
  static constexpr int kNoScene = -1;

  // Dense strays hit hundreds of thousands: bins take 32 bits, those of thirty years.
  struct Place {
    RecentBins hits;  // in the voxel, up to `bin`
    std::int32_t bin = 0;
    Eigen::Vector3f point_m = Eigen::Vector3f::Zero();  // the last return
    std::uint32_t num_returns = 0;
    int scene = kNoScene;  // to which `floats` refers
    // The last verdict: valid for the bins of its dwell, until the newest bin is `valid_until`, or
    // until its turn in the next one.
    std::int32_t valid_until = -1;
    std::int32_t dwell_first = 0;
    std::int32_t dwell_last = 0;
    float place_rate = 0.0F;
    float stray_rate = 0.0F;
    // Bins outside this dwell, when enough were exposed.
    std::int16_t past_occupied = 0;
    std::int16_t past_exposed = 0;
    bool is_own = false;  // `point_m` lies in this shell
    bool floats = false;
    bool is_structure = false;
    bool is_unknown = false;  // too few bins are exposed
    bool is_supporter = false;
    bool is_behind_strays = false;
  };

  void CountFrame(std::int64_t bin);
  double MinExposed() const;
  void Age(Place* place) const;
  RecentBins HitsOf(const Place& place) const;  // up to the newest bin
  RecentBins HitsAround(const Eigen::Vector3f& point_m) const;
  RecentBins VisibleBins(const Place& place, int age, const RecentBins& hits,
                         const Dwell& dwell) const;
  Eigen::Vector3f NearerPlaceM(const Eigen::Vector3f& point_m, float share) const;
  double RateThroughout(const RecentBins& hits, const Eigen::Vector3f& point_m) const;
  double VoxelRate(const Eigen::Vector3f& point_m, std::optional<int> age = {}) const;
  double EvenRate(const Eigen::Vector3f& point_m, const RecentBins& bins) const;
  bool AreStraysEnough(const Eigen::Vector3f& point_m, double voxel_rate) const;
  double RateOf(double occupied, double exposed, const Eigen::Vector3f& point_m) const;
  bool IsLong(const Place& place) const;
  bool IsValid(const Place& place, std::int64_t bin) const;
  // Evenly distributed, and the same for all returns of a place in one bin.
  static int ChanceOf(const Place& place) { return static_cast<int>(1e3F * place.point_m.norm()); }
  void JudgeAnew(const Eigen::Vector3f& point_m, int age, Place* place) const;

  BackgroundConfig config_;
  bool knows_strays_;
  int max_break_;
  std::int32_t newest_ = 0;
  RecentBins observed_;                      // bins with frames
  std::vector<std::uint32_t> frame_counts_;  // (RecentBins::kWindow) by bin modulo the window
  std::uint32_t num_frames_ = 0;             // sum of these
  int turns_ = 0;                            // of the newest bin that have come
  bool has_many_returns_ = false;            // the last frame has more than kManyReturns
  Occlusion occlusion_;
  ShellTable<Place> places_;
};

}  // namespace unlidar
