// Everything that can be set, with its default: the one place of defaults. configs/default.yaml,
// which explains each key to users, is held equal by a test.
//
// Names are those of the keys of the file, units at their end.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <string>
#include <vector>

namespace unlidar {

// Which instant of a frame its stamp names; used for frames without point times.
enum class StampMeaning { kBegin, kMiddle, kEnd };

struct InputConfig {
  bool skip_bad_frames = false;
  double scale_m = 1.0;                       // metres in a unit of the coordinates
  double frame_rate_hz = 0.0;                 // of frames that are numbered; 0: not given
  double min_range_m = 0.5;                   // nearer returns are the station itself
  double max_range_m = 2000.0;                // beyond any LiDAR: absurd coordinates
  StampMeaning stamp = StampMeaning::kBegin;  // Livox and most ROS drivers stamp the first ray
};

// Pose and clock of a sensor: p_common = R(rotation) p_sensor + translation_m.
struct SensorConfig {
  Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();
  Eigen::Vector4d rotation_xyzw = Eigen::Vector4d(0, 0, 0, 1);  // unit quaternion
  double time_offset_s = 0.0;                                   // added to every stamp
  double frame_rate_hz = 0.0;                                   // in place of the input's; 0: that
};

// Radius of a neighbourhood as a function of range: constant_m + slope * range. The constant stands
// for the size of things, the slope for the spacing of rays, which no place can resolve better.
struct RangeRadius {
  double constant_m = 0.35;
  double slope = 0.012;

  double At(double range_m) const { return constant_m + slope * range_m; }
};

struct BackgroundConfig {
  RangeRadius place{0.35, 0.012};  // what counts as the same place
  double bin_s = 0.5;              // time resolution of occupancy
  double max_break_s = 1.5;        // a stay ends where a place was empty for longer
  double min_exposure = 0.15;      // a place must be known for this share of the recording
  double max_occupancy = 0.35;     // share of the other bins: more is structure
  double occluder_cell_deg = 2.0;  // directions in which something nearer hides a place
  double occluder_margin_m = 2.0;
};

struct GroundConfig {
  double cell_m = 4.0;
  double max_slope = 0.3;    // a steeper plane is a wall or a crown
  double thickness_m = 0.3;  // what is lower is ground: grass, noise
};

struct SupportConfig {
  // Structure, ground or station as near as this holds a thing up, whether or not what joins the
  // two is seen: poles and wires are thin,
  RangeRadius reach{1.5, 0.1};
  // and farther away than this little is seen well: only what is alone for so far floats there,
  double far_m = 50.0;
  RangeRadius far_reach{1.5, 0.3};
  double max_range_m = 100.0;  // and beyond this nobody knows.
  double body_m = 1.5;         // structure nearer than this may be the thing itself
  double voxel_m = 0.25;       // resolution of structure
  // Where more than this of the directions about a thing is hidden, so may be what holds it.
  double max_hidden_share = 0.2;

  double ReachM(double range_m) const { return (range_m < far_m ? reach : far_reach).At(range_m); }
};

struct PlotConfig {
  RangeRadius link{0.5, 0.008};  // single linkage of the returns of one frame
  double body_contact_m = 1.0;   // a body reaches down to this height above the ground
  int body_contact_returns = 3;
  double body_spread_m = 0.6;  // or is wider than any drone in two directions (std. dev.)
  int body_spread_returns = 6;
  // Noise of a plot: a constant part (a body is no point), a part that falls with the number of
  // returns, and one that grows with range (beam divergence, angular steps).
  double noise_m = 0.06;
  double noise_per_return_m = 0.14;
  double noise_per_range = 0.003;
  // Where other plots tell of clutter, within a wide neighbourhood.
  RangeRadius clutter_middle{4.0, 0.12};
  RangeRadius clutter_narrow{1.5, 0.04};
  RangeRadius spot{0.19, 0.006};  // the extent of a static thing that is a point to the sensor
};

struct TrackerConfig {
  std::vector<double> sigma_a_mps2 = {1.0, 3.0, 8.0};  // agility tried: hover, transit, sport
  double manoeuvre_log = -2.3;  // log probability of more agility yet between two plots
  std::vector<double> birth_speeds_mps = {1.0, 8.0};  // standard deviations per axis tried
  double even_birth_share = 0.1;  // of the births; the others fall in proportion to volume
  double max_speed_mps = 35.0;
  double max_gap_s = 10.0;        // without a plot
  int hypotheses_per_plot = 2;    // kept at each plot and agility
  double echo_m2_per_s = 4000.0;  // expected returns per second of a typical drone, times range^2;
  double echo_shape = 1.5;        // shape of the gamma distribution about it
  // Carried on at any time, the best first: so many, and so many more for each plot of the frame.
  int max_hypotheses = 500;
  int max_hypotheses_per_plot = 5;
  int max_paths = 20;
  double min_fragment_log = 7.0;  // weaker paths are not looked at,
  int min_fragment_plots = 3;     // nor shorter ones
  double birth_cost = 12.0;       // what a further target must explain
  double min_exchange_log = 1.0;  // least gain of an exchange or a join
  double give_up_log = -6.0;      // a hypothesis worse than this is dropped,
  double rebirth_log = -3.0;      // as is one so much worse than a new one at its last plot
};

struct CollectConfig {
  int rounds = 3;              // of fit and collection
  double body_sigma_m = 0.15;  // spread of the returns over the body, per axis
  // The centre of a body lies behind the mean of its returns by this share of their spread: 1.33
  // for a ball, less for a flat thing with gaps; 0 leaves the mean.
  double facing_side = 0.4;
  // How far two sensors disagree, prior standard deviations: in place and clock.
  double sensor_bias_m = 0.2;
  double sensor_delay_s = 0.05;
};

// What can be switched off to see what it is worth, each by a reason of its own (docs/explain.md).
enum class Rule {
  kTransient,        // what comes and goes high in the air is held up by nothing hidden
  kPermutationNull,  // the threshold also exceeds the clutter with its frames in random order
  kDwell,            // a path has the returns where it stood before it took off and after it landed
  kSpots,            // returns are weighed against what their very spots show at other times
  kAlternatives,     // sigmas grow where another continuation is nearly as likely
  kFrameLength,      // the length of frames without times of points, by the streaks in them
  kCrowded,          // the penalty for what else is detected about a path at its time
  kSuspended,        // the gates: what hangs,
  kClutterReturns,   // what its places' clutter explains better,
  kCloud,            // steam, smoke, dust,
  kInsect            // and what is narrower than any drone
};

struct RobustConfig {
  double false_alarms_per_recording = 1e-3;  // tracks expected where there is no drone
  // Longer recordings are searched in windows, with so much before and behind each; infinity: none.
  double window_s = 90.0;
  double window_margin_s = 5.0;
  int min_plots = 5;               // frames with evidence: clutter that repeats is not independent
  int rounds = 2;                  // of clutter estimation and search
  double off_ground_m = 2.0;       // a target is higher than this,
  double off_ground_share = 0.42;  // for this share of its plots
  double min_echo_m2_per_s = 150.0;  // returns per second times range^2: less is an insect
  std::vector<Rule> disabled_rules;  // of a recording, for an ablation
  BackgroundConfig background;
  GroundConfig ground;
  SupportConfig support;
  PlotConfig plots;
  TrackerConfig tracker;
  CollectConfig collect;

  bool Uses(Rule rule) const {
    return std::find(disabled_rules.begin(), disabled_rules.end(), rule) == disabled_rules.end();
  }
};

struct TrajectoryConfig {
  double typical_acceleration_mps2 = 2.0;  // sigma_a where the data says little
  // k, the true noise over the one that the covariances state: limits.
  double min_noise_scale = 0.5;
  double max_noise_scale = 3.0;
  double outlier_distance = 4.5;  // sigmas (3-D) at which a measurement is as likely an outlier
  double min_knot_spacing_s = 0.05;
  double max_knot_spacing_s = 0.2;
  double max_extrapolation_s = 5.0;  // beyond the measurements, with a sigma that is still true
  // Rows go on beyond the first and last return through a silence that is likelier than this.
  double silence_probability = 0.01;
  double max_sigma_m = 0.9;  // rows whose largest sigma exceeds it are not written
};

struct LiveConfig {
  double delay_s = 1.0;                // of a row behind its instant; infinity: all rows at the end
  double window_s = 60.0;              // of what is remembered frame by frame; infinity: everything
  double reorder_s = 0.2;              // by which a frame may come later than newer ones
  double false_alarms_per_hour = 0.1;  // of an empty sky
  double silent_s = 2.0;               // without a frame: the sensor is silent
  double overload_s = 2.0;  // that a frame waits, by the wall clock, before others are dropped
  double frame_s = 0.1;     // of the frames into which packets (--livox) are cut
};

enum class ClusterMethod { kEuclidean, kDbscan };
enum class ClusterEngine { kGrid, kPcl };

struct ClusteringConfig {
  ClusterMethod method = ClusterMethod::kEuclidean;
  ClusterEngine engine = ClusterEngine::kGrid;
  double tolerance_m = 0.5;  // eps of DBSCAN; 1e-6 to 1e6
  int min_neighbours = 5;    // DBSCAN only: a core point has so many within eps, itself included
  int min_cluster_size = 1;  // smaller clusters become noise
};

// What the local cluster of global cluster k is. The share is the reading that keeps the index k
// (and the released code); the largest is that of clustering each window on its own.
enum class LocalClusters { kShareOfGlobal, kLargestOfWindow };

// Windows in which a cluster has no return: either they do not exist, so that IoU is taken between
// the windows next to each other among the occupied ones, or each edge of a gap is a pair of IoU 0.
enum class EmptyWindows { kSkip, kZeroIou };

// R from the densities rho of a local cluster and of its global cluster. Only frame / merged bears
// out what the text says of static surfaces, which pile up returns in the same voxels. The literal
// merged / frame is about the number of windows for a wall and makes it win. The released code has
// |frame - merged| / merged.
enum class DensityReading { kFrameOverMerged, kMergedOverFrame, kRelativeDifference };

// What psi_rho sums: e^R, or R itself.
enum class DensityTerm { kExponential, kLinear };

// What psi_iou sums over window pairs: all fall with the overlap, -ln(IoU) and 1 / IoU without
// bound. An IoU below PaperConfig::min_iou counts as that.
enum class IouTerm { kLogarithm, kInverse, kComplement };

// Sums over windows and pairs grow with the time a cluster was seen; means do not.
enum class Accumulation { kMean, kSum };

struct PaperConfig {
  ClusteringConfig global_clusters = {ClusterMethod::kDbscan, ClusterEngine::kGrid, 0.5, 5, 10};
  ClusteringConfig local_clusters = {ClusterMethod::kEuclidean, ClusterEngine::kGrid, 0.5, 5, 1};
  LocalClusters local = LocalClusters::kShareOfGlobal;  // local_clusters serves the other reading
  int window_frames = 1;                                // frames of all sensors together
  double voxel_size_m = 0.2;
  double lambda = 1.0;  // weight of psi_iou in psi
  DensityReading density_reading = DensityReading::kFrameOverMerged;
  DensityTerm density_term = DensityTerm::kExponential;
  IouTerm iou_term = IouTerm::kLogarithm;
  double min_iou = 0.01;
  EmptyWindows empty_windows = EmptyWindows::kSkip;
  Accumulation accumulation = Accumulation::kMean;
  int min_windows = 2;           // a cluster seen in fewer cannot win
  double return_sigma_m = 0.05;  // noise of one return about the centre of the target
};

enum class Method { kRobust, kPaper };

struct Config {
  Method method = Method::kRobust;
  InputConfig input;
  std::map<std::string, SensorConfig> sensors;  // by name; others stand at the origin
  PaperConfig paper;
  RobustConfig robust;
  TrajectoryConfig trajectory;
  LiveConfig live;
};

// The defaults, overlaid by the YAML file (none for an empty path), overlaid by `section.key=value`
// assignments in their order.
// Throws ConfigError for an unreadable file, bad YAML, an unknown or repeated key, a value that
// breaks its constraint; UsageError for an assignment that is not `key=value`.
Config LoadConfig(const std::string& path, const std::vector<std::string>& assignments = {});

// Throws ConfigError for a value that breaks its constraint, naming key, value and constraint. What
// LoadConfig() gives has none; Engine and TrackRecording() ask it of every config.
void CheckConfig(const Config& config);

}  // namespace unlidar
