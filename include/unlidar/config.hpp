// All settings and their defaults, the one place of defaults. configs/default.yaml, which documents
// each key for users, is kept equal by a test.
//
// Members are named like the keys of the file, with the unit as suffix.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "unlidar/types.hpp"

namespace unlidar {

// Instant of a frame that its stamp refers to; used for frames without point times.
enum class StampMeaning { kBegin, kMiddle, kEnd };

struct InputConfig {
  bool skip_bad_frames = false;
  double scale_m = 1.0;                       // metres per unit of the coordinates
  double frame_rate_hz = 0.0;                 // of numbered frames; 0: not given
  double min_range_m = 0.5;                   // closer returns are the station itself
  double max_range_m = 2000.0;                // beyond any LiDAR: invalid coordinates
  StampMeaning stamp = StampMeaning::kBegin;  // Livox and most ROS drivers stamp the first ray
};

// Pose and clock of a sensor: p_common = R(rotation) p_sensor + translation_m.
struct SensorConfig {
  Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();
  Eigen::Vector4d rotation_xyzw = Eigen::Vector4d(0, 0, 0, 1);  // unit quaternion
  double time_offset_s = 0.0;                                   // added to every stamp
  double frame_rate_hz = 0.0;                                   // overrides the input's; 0: input's
};

// Radius of a neighbourhood as a function of range: constant_m + slope * range. The constant is the
// size of objects, the slope the spacing of rays, which limits the resolution of places.
struct RangeRadius {
  double constant_m = 0.0;
  double slope = 0.0;

  double At(double range_m) const { return constant_m + slope * range_m; }
};

struct BackgroundConfig {
  RangeRadius place{0.35, 0.012};  // extent of one place
  double max_dwell_gap_s = 1.5;    // a dwell ends where a place was empty for longer
  double min_exposure = 0.15;      // share of the recording for which a place must be known
  double max_occupancy = 0.35;     // share of the other bins; above it: structure
};

struct SupportConfig {
  // Structure, ground or a station within this distance supports an object even if no connection
  // is seen: poles and wires are thin.
  RangeRadius reach{1.5, 0.1};
  double max_range_m = 100.0;  // support is unknown beyond
};

struct PlotConfig {
  RangeRadius link{0.5, 0.008};  // single linkage of the returns of one frame
  double body_spread_m = 0.6;    // wider along two axes (std. dev.) than any drone: a vehicle
  // Noise of a plot, method.md (1): a constant part (targets have an extent), a part that falls
  // with the number of returns, and one that grows with range (beam divergence, angular steps).
  double noise_m = 0.06;
  double noise_per_return_m = 0.14;
  double noise_per_range = 0.003;
};

struct TrackerConfig {
  std::vector<double> sigma_a_mps2 = {1.0, 3.0, 8.0};  // agilities searched: hover, transit, sport
  double manoeuvre_log_probability = -2.3;             // between two plots
  std::vector<double> birth_speeds_mps = {1.0, 8.0};   // std. dev. per axis, all searched
  double uniform_birth_share = 0.1;                    // over plots; the others scale with volume
  double max_speed_mps = 35.0;
  double gate_sigmas = 4.0;  // [S] of a manoeuvre; plots beyond are of other targets
  double max_gap_s = 10.0;   // without a plot
  // That a target is out of view between two plots: a run of missed detections is no less likely.
  double out_of_view_probability = 0.1;
  int hypotheses_per_plot = 2;           // kept at each plot and agility
  double return_rate_m2_per_s = 4000.0;  // of a typical drone: returns per second times range^2
  int max_hypotheses = 500;              // carried on, best first; more in a frame of many plots
};

struct CollectConfig {
  double extent_sigma_m = 0.15;  // spread of the returns over the target, per axis
  // Distance of the target's centre behind the centroid of its returns, over their spread, unless
  // they show a ball (Rule::kRoundBodies), which has 1.33; 0 leaves the centroid.
  double centroid_offset = 0.4;
  // Disagreement of two sensors in position and clock, prior standard deviations.
  double sensor_bias_m = 0.2;
  double sensor_delay_s = 0.05;
};

// Rules that can be switched off for an ablation, [R] of recordings or [S] of streams only;
// docs/explain.md has the reason for each.
enum class Rule {
  kTransient,         // [R] transient places high in the air have no hidden support
  kDwell,             // [R] dwells before take-off and after landing belong to the path
  kSpots,             // [R] returns are weighed against the clutter of their very spots
  kAlternatives,      // [R] sigmas include alternative modes
  kSway,              // sway of a station without poses is estimated and removed
  kFrameLength,       // length of frames without point times, estimated from streaks
  kCrowded,           // other detections near a path at the same time count against it
  kBodies,            // people and vehicles yield no plots
  kStrays,            // strays of weather are neither structure nor parts of bodies
  kStrayGroups,       // more returns side by side than strays group to by chance are kept
  kLocalClutter,      // the clutter intensity is estimated in narrowing neighbourhoods
  kSecondRound,       // [R] targets of a first search are left out of the clutter of a second
  kRoundBodies,       // how far the centre lies behind the returns is told by their shape
  kCollection,        // [R] all returns along a path are collected, not only those of its plots
  kAgilityChange,     // [S] a target that has flown calmly may manoeuvre, and the reverse
  kGroundPast,        // [S] paths of ground targets do not go on to drones
  kGroundClaim,       // [S] a lost track leaves their plots to ground targets
  kLikelierRefusal,   // [S] most plots of a likelier path that a gate refuses are no target
  kClutterLearning,   // [S] the threshold is higher while the clutter is hardly known
  kOnStructure,       // gates: people and vehicles on bridges and roofs,
  kPause,             // plots beside a pause that are another target's,
  kStationary,        // objects at rest: [S] supported ones, those that the sensor passes,
  kSurge,             // [S] plots while the clutter changes,
  kSuspended,         // suspended objects,
  kCloud,             // steam, smoke, dust,
  kGrowth,            // which grow, as a body does not,
  kVolumeScattering,  // and are seen into,
  kCloudParts,        // [R] but for a part of their path that is certainly none,
  kInsect             // targets narrower than any drone
};

struct RobustConfig {
  double false_alarms_per_recording = 1e-3;  // expected in a recording without drones
  // Longer recordings are searched in windows with this margin on each side.
  double window_s = 90.0;
  double window_margin_s = 5.0;
  int min_plots = 5;          // frames with evidence: clutter that repeats is not independent
  double off_ground_m = 2.0;  // people and vehicles are no higher above ground
  double min_cross_section_m2 = 0.006;  // an insect or a leaf has less
  std::vector<Rule> disabled_rules;     // for ablations
  BackgroundConfig background;
  SupportConfig support;
  PlotConfig plots;
  TrackerConfig tracker;
  CollectConfig collect;

  bool Uses(Rule rule) const {
    return std::find(disabled_rules.begin(), disabled_rules.end(), rule) == disabled_rules.end();
  }
};

// Parts of the model of motion that can be switched off for an ablation, in streams, too.
enum class MotionRule {
  kAgility,          // sigma_a varies along the flight
  kDirection,        // a target is more agile along its direction than across it
  kAccelerationTime  // tau is that of the flight, not a typical one
};

struct TrajectoryConfig {
  double typical_acceleration_mps2 = 2.0;  // sigma_a if the data says little
  double max_extrapolation_s = 5.0;        // beyond the measurements, with a valid sigma
  // Rows continue beyond the first and last return while the run of missed detections is likelier.
  double min_missed_run_probability = 0.01;
  double max_sigma_m = 0.9;                // rows with a larger sigma are not written
  std::vector<MotionRule> disabled_rules;  // for ablations

  bool Uses(MotionRule rule) const {
    return std::find(disabled_rules.begin(), disabled_rules.end(), rule) == disabled_rules.end();
  }
};

struct LiveConfig {
  double delay_s = 1.0;                // of rows; infinity: all rows at the end
  double window_s = 60.0;              // of the scene memory; infinity: everything
  double reorder_s = 0.2;              // by which a frame may arrive after newer ones
  double false_alarms_per_hour = 0.1;  // expected in an empty sky
  double silent_s = 2.0;               // a sensor without frames for this long is silent
  double overload_s = 2.0;             // wall-clock wait of a frame above which frames are dropped
  double frame_s = 0.1;                // length of the frames cut from packets (--livox)
};

enum class ClusterMethod { kEuclidean, kDbscan };
enum class ClusterEngine { kGrid, kPcl };

struct ClusteringConfig {
  ClusterMethod method = ClusterMethod::kEuclidean;
  ClusterEngine engine = ClusterEngine::kGrid;
  double tolerance_m = 0.5;  // eps of DBSCAN; 1e-6 to 1e6
  int min_neighbours = 5;    // DBSCAN only: of a core point within eps, itself included
  int min_cluster_size = 1;  // smaller clusters become noise
};

// Definition of the local cluster of global cluster k. The share is the reading that keeps the
// index k (and the released code); the largest is that of clustering each window separately.
enum class LocalClusters { kShareOfGlobal, kLargestOfWindow };

// Windows without a return of a cluster: either skipped, so that IoU is taken between consecutive
// occupied windows, or each edge of a gap counts as a pair of IoU 0.
enum class EmptyWindows { kSkip, kZeroIou };

// R from the densities rho of a local cluster and of its global cluster. Only frame / merged agrees
// with the paper's text on static surfaces, which pile up returns in the same voxels. The literal
// merged / frame is about the number of windows for a wall and makes it win. The released code has
// |frame - merged| / merged.
enum class DensityReading { kFrameOverMerged, kMergedOverFrame, kRelativeDifference };

// Summand of psi_rho: e^R or R.
enum class DensityTerm { kExponential, kLinear };

// Summand of psi_iou over window pairs. All decrease with overlap; -ln(IoU) and 1 / IoU are
// unbounded. IoU is clamped to PaperConfig::min_iou from below.
enum class IouTerm { kLogarithm, kInverse, kComplement };

// Sums over windows and pairs grow with the time for which a cluster was seen; means do not.
enum class Accumulation { kMean, kSum };

struct PaperConfig {
  ClusteringConfig global_clusters = {ClusterMethod::kDbscan, ClusterEngine::kGrid, 0.5, 5, 10};
  ClusteringConfig local_clusters = {ClusterMethod::kEuclidean, ClusterEngine::kGrid, 0.5, 5, 1};
  LocalClusters local = LocalClusters::kShareOfGlobal;  // local_clusters is for the other reading
  int window_frames = 1;                                // frames of all sensors together
  double voxel_size_m = 0.2;
  double lambda = 1.0;  // weight of psi_iou in psi
  DensityReading density_reading = DensityReading::kFrameOverMerged;
  DensityTerm density_term = DensityTerm::kExponential;
  IouTerm iou_term = IouTerm::kLogarithm;
  double min_iou = 0.01;
  EmptyWindows empty_windows = EmptyWindows::kSkip;
  Accumulation accumulation = Accumulation::kMean;
  int min_windows = 2;           // a cluster in fewer windows cannot win
  double return_sigma_m = 0.05;  // noise of one return about the centre of the target
};

enum class Method { kRobust, kPaper };

// Poses of the carrier of a sensor, in order of time, by the name of the sensor; empty name: of all
// others.
using PosesByName = std::map<std::string, std::shared_ptr<const std::vector<Pose>>>;

struct Config {
  Method method = Method::kRobust;
  InputConfig input;
  std::map<std::string, SensorConfig> sensors;  // by name; others are at the origin
  PosesByName poses;                            // of carriers; others are at rest
  PaperConfig paper;
  RobustConfig robust;
  TrajectoryConfig trajectory;
  LiveConfig live;
};

// Returns the defaults, overridden by the YAML file (none for an empty path), then by
// `section.key=value` assignments in order.
// Throws ConfigError for an unreadable file, bad YAML, an unknown or repeated key, or a value that
// violates its constraint; UsageError for an assignment that is not `key=value`.
Config LoadConfig(const std::string& path, const std::vector<std::string>& assignments = {});

// Throws ConfigError for a value that violates its constraint, naming key, value and constraint.
// Configs from LoadConfig() are valid; Engine and TrackRecording() check every config.
void CheckConfig(const Config& config);

}  // namespace unlidar
