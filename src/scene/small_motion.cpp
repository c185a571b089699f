#include "scene/small_motion.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "base/angles.hpp"

namespace unlidar {
namespace {

// Of the map of surfaces.
constexpr double kMinEdgeM = 0.5;
constexpr double kEdgesPerRange = 12.0;  // the edge is at most a twelfth of the range
constexpr double kMaxRangeM = 120.0;     // beyond, cells hold too few returns
constexpr std::size_t kMostCells = 20'000;

constexpr double kMinCount = 8.0;
constexpr double kRefit = 1.3;  // a surface is computed again when so many times the returns are in
// Old returns fade, those placed by an early attitude first.
constexpr double kMaxCount = 100.0;

// Evenly filled cells have a standard deviation of 0.29 edges along each axis.
constexpr double kThin = 0.2;
constexpr double kNoiseM = 0.02;  // of a range

struct Place {
  std::uint32_t grid = 0;
  VoxelKey key = 0;
  double edge_m = 0.0;
  Eigen::Vector3d centre_m = Eigen::Vector3d::Zero();
};

Place PlaceOf(const Eigen::Vector3d& position_m, double range_m) {
  const int level = std::max(0, std::ilogb(range_m / (kEdgesPerRange * kMinEdgeM)));
  Place place;
  place.edge_m = std::ldexp(kMinEdgeM, level);
  place.grid = static_cast<std::uint32_t>(level);
  const Eigen::Array3d number = (position_m.array() / place.edge_m).floor();
  place.centre_m = (number + 0.5) * place.edge_m;
  const auto indices = number.cast<std::int64_t>().eval();
  place.key = KeyOf({indices[0], indices[1], indices[2]});
  return place;
}

// Spectral density of the acceleration: a mast that sways by 1 degree at 0.4 Hz accelerates by
// 4 degrees/s^2, and its head, 6 m up, by 0.5 m/s^2.
constexpr double kTurnNoise = 4.0 * kRadPerDeg;  // rad/s^1.5
constexpr double kShiftNoise = 0.4;              // m/s^1.5, horizontally
// A mast that tilts keeps its height to within a millimetre.
constexpr double kLiftShare = 0.05;
// Prior of each frame about the pose at rest, for motions that no surface constrains.
constexpr double kTurnRad = 0.7 * kRadPerDeg;
constexpr double kShiftM = 0.1;
constexpr double kFirstTurnRadPerS = 3.0 * kRadPerDeg;
constexpr double kFirstShiftMps = 0.3;

// Residuals beyond this many standard deviations weigh little (Geman and McClure), from large to
// small.
constexpr std::array<double, 4> kScales = {8.0, 4.0, 3.0, 3.0};
// Errors of returns on one surface are not independent.
constexpr double kInformationShare = 0.5;

constexpr double kSectorRad = 15.0 * kRadPerDeg;
constexpr double kMaxError = 9.0;  // of a return, in variances: strays count as three sigmas

using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Returns which half of a frame a return belongs to: sectors of azimuth alternate.
std::size_t HalfOf(const Eigen::Vector3d& position_m) {
  const double azimuth_rad = std::atan2(position_m.y(), position_m.x()) + M_PI;
  return static_cast<std::size_t>(azimuth_rad / kSectorRad) % 2;
}

Vector6d PriorInformation() {
  Vector6d information;
  information.head<3>().setConstant(1.0 / (kTurnRad * kTurnRad));
  information.tail<3>().setConstant(1.0 / (kShiftM * kShiftM));
  information[5] /= kLiftShare * kLiftShare;
  return information;
}

}  // namespace

void SurfaceMap::Add(const Eigen::Vector3d& position_m) {
  const double range_m = position_m.norm();
  if (range_m > kMaxRangeM) return;
  const Place place = PlaceOf(position_m, range_m);
  if (cells_.size() >= kMostCells && numbers_.Find(place.grid, place.key) == VoxelNumbers::kNone) {
    return;
  }
  const std::uint32_t number = numbers_.FindOrAdd(place.grid, place.key);
  if (number == cells_.size()) cells_.emplace_back();
  Cell& cell = cells_[number];
  if (cell.count >= kMaxCount) {
    cell.count /= 2.0;
    cell.count_of_fit /= 2.0;
    cell.sum_m /= 2.0;
    cell.squares_m2 /= 2.0;
  }
  const Eigen::Vector3d offset_m = position_m - place.centre_m;
  ++cell.count;
  cell.sum_m += offset_m;
  cell.squares_m2 += offset_m * offset_m.transpose();
  if (cell.count < kMinCount || cell.count < kRefit * cell.count_of_fit) return;
  cell.count_of_fit = cell.count;
  const Eigen::Vector3d mean_m = cell.sum_m / cell.count;
  const Eigen::Matrix3d covariance_m2 = cell.squares_m2 / cell.count - mean_m * mean_m.transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
  axes.computeDirect(covariance_m2);
  Surface& surface = cell.surface;
  surface.mean_m = place.centre_m + mean_m;
  surface.num_normals = 0;
  for (int axis = 0; axis < 3; ++axis) {  // in ascending order
    const double variance_m2 = std::max(axes.eigenvalues()[axis], 0.0) + kNoiseM * kNoiseM;
    if (variance_m2 > kThin * kThin * place.edge_m * place.edge_m) break;
    const auto normal = static_cast<std::size_t>(surface.num_normals++);
    surface.normals[normal] = axes.eigenvectors().col(axis);
    surface.variances_m2[normal] = variance_m2;
  }
}

const SurfaceMap::Surface* SurfaceMap::Find(const Eigen::Vector3d& position_m) const {
  const double range_m = position_m.norm();
  if (range_m > kMaxRangeM) return nullptr;
  const Place place = PlaceOf(position_m, range_m);
  const std::uint32_t number = numbers_.Find(place.grid, place.key);
  if (number == VoxelNumbers::kNone || cells_[number].surface.num_normals == 0) return nullptr;
  return &cells_[number].surface;
}

void SmallMotionFilter::Begin(TimeNs time_ns) {
  motion_ = SmallMotion();
  motion_.time_ns = time_ns;
  rest_.setZero();
  covariance_.setZero();
  covariance_.diagonal().head<6>() = PriorInformation().cwiseInverse();
  covariance_.diagonal().segment<3>(6).setConstant(kFirstTurnRadPerS * kFirstTurnRadPerS);
  covariance_.diagonal().tail<3>().setConstant(kFirstShiftMps * kFirstShiftMps);
}

void SmallMotionFilter::Predict(TimeNs time_ns) {
  if (time_ns <= motion_.time_ns) return;
  const double s = static_cast<double>(time_ns - motion_.time_ns) * kSecondsPerNs;
  motion_.pose = motion_.At(time_ns);
  motion_.time_ns = time_ns;
  Matrix12d transition = Matrix12d::Identity();
  transition.topRightCorner<6, 6>().diagonal().setConstant(s);
  covariance_ = transition * covariance_ * transition.transpose();
  Vector6d density;
  density.head<3>().setConstant(kTurnNoise * kTurnNoise);
  density.tail<3>().setConstant(kShiftNoise * kShiftNoise);
  density[5] *= kLiftShare * kLiftShare;
  covariance_.topLeftCorner<6, 6>().diagonal() += density * (s * s * s / 3.0);
  covariance_.topRightCorner<6, 6>().diagonal() += density * (s * s / 2.0);
  covariance_.bottomLeftCorner<6, 6>().diagonal() += density * (s * s / 2.0);
  covariance_.bottomRightCorner<6, 6>().diagonal() += density * s;
}

SmallMotionFilter::Fit SmallMotionFilter::Update(const std::vector<TimedReturn>& returns,
                                                 const SurfaceMap& map) {
  Fit fit;
  halves_.clear();
  for (const TimedReturn& one : returns) halves_.push_back(HalfOf(one.position_m));
  Vector12d predicted;
  predicted << motion_.pose, motion_.rate_per_s;
  Vector12d state = predicted;
  Vector12d matched_state;
  const Matrix12d prior = covariance_.ldlt().solve(Matrix12d::Identity());
  Matrix12d information;
  for (const double scale : kScales) {
    matched_state = state;
    fit.matched = Match(returns, map, state, scale);
    information = prior;
    information.diagonal().head<6>() += PriorInformation();
    Vector12d vector = prior * (predicted - state);
    vector.head<6>() += PriorInformation().cwiseProduct(rest_ - state.head<6>());
    for (const Row& row : rows_) {
      const Matrix6d square = row.weight_per_m2 * row.gradient * row.gradient.transpose();
      information.topLeftCorner<6, 6>() += square;
      information.topRightCorner<6, 6>() += row.s * square;
      information.bottomRightCorner<6, 6>() += row.s * row.s * square;
      const Vector6d pull = -row.weight_per_m2 * row.distance_m * row.gradient;
      vector.head<6>() += pull;
      vector.tail<6>() += row.s * pull;
    }
    information.bottomLeftCorner<6, 6>() = information.topRightCorner<6, 6>().transpose();
    state += information.ldlt().solve(vector);
  }
  covariance_ = information.ldlt().solve(Matrix12d::Identity());
  motion_.pose = state.head<6>();
  motion_.rate_per_s = state.tail<6>();
  CompareHalves(matched_state, &fit);
  return fit;
}

std::size_t SmallMotionFilter::Match(const std::vector<TimedReturn>& returns, const SurfaceMap& map,
                                     const Vector12d& state, double scale) {
  rows_.clear();
  std::size_t matched = 0;
  for (std::size_t i = 0; i < returns.size(); ++i) {
    const TimedReturn& one = returns[i];
    const double s = static_cast<double>(one.time_ns - motion_.time_ns) * kSecondsPerNs;
    const Eigen::Vector3d position_m = Moved(state.head<6>() + s * state.tail<6>(), one.position_m);
    const SurfaceMap::Surface* const surface = map.Find(position_m);
    if (surface == nullptr) continue;
    bool is_matched = false;
    for (std::size_t axis = 0; axis < static_cast<std::size_t>(surface->num_normals); ++axis) {
      const Eigen::Vector3d& normal = surface->normals[axis];
      const double variance_m2 = surface->variances_m2[axis];
      const double distance_m = normal.dot(position_m - surface->mean_m);
      const double ratio = 1.0 + distance_m * distance_m / (scale * scale * variance_m2);
      is_matched = is_matched || ratio < 2.0;
      Row& row = rows_.emplace_back();
      row.gradient << position_m.cross(normal), normal;
      row.s = s;
      row.distance_m = distance_m;
      row.variance_m2 = variance_m2;
      row.weight_per_m2 = kInformationShare / (variance_m2 * ratio * ratio);
      row.half = halves_[i];
    }
    matched += is_matched ? 1 : 0;
  }
  return matched;
}

void SmallMotionFilter::CompareHalves(const Vector12d& state, Fit* fit) const {
  const Vector6d to_rest = rest_ - state.head<6>();
  std::array<Matrix6d, 2> information;
  std::array<Vector6d, 2> step;
  information.fill(Matrix6d(PriorInformation().asDiagonal()));
  step.fill(PriorInformation().cwiseProduct(to_rest));
  for (const Row& row : rows_) {
    information[row.half] += row.weight_per_m2 * row.gradient * row.gradient.transpose();
    step[row.half] -= row.weight_per_m2 * row.distance_m * row.gradient;
  }
  for (std::size_t half = 0; half < 2; ++half) {
    step[half] = information[half].ldlt().solve(step[half]);
    fit->half_rad[half] = (state.head<6>() + step[half]).head<3>();
  }
  for (const Row& row : rows_) {
    const auto error = [&](const Vector6d& by) {
      const double distance_m = row.distance_m + row.gradient.dot(by);
      return std::min(distance_m * distance_m / row.variance_m2, kMaxError);
    };
    fit->rest_error += error(to_rest - row.s * state.tail<6>());
    fit->held_out_error += error(step[1 - row.half]);
  }
}

double SmallMotionFilter::SigmaRad() const {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
  axes.computeDirect(covariance_.topLeftCorner<3, 3>(), Eigen::EigenvaluesOnly);
  return std::sqrt(axes.eigenvalues()[2]);
}

}  // namespace unlidar
