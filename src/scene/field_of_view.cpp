#include "scene/field_of_view.hpp"

#include <numeric>
#include <utility>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

constexpr float kNoneSeen = 2.0F;  // initial value, outside the range of a sine
// Beams of one ring or edge agree within some hundredths of a degree. The edge of a flat roof
// leaves this band within a few columns, because its elevation rises where it is nearer.
constexpr double kSharpRad = 0.15 * M_PI / 180.0;
// Of a carrier that moves: it turns within a frame, and its poses have noise.
constexpr double kSharpOfMovingRad = 0.4 * M_PI / 180.0;
constexpr std::ptrdiff_t kMinColumns = 8;
constexpr float kAlikeRad = 0.02F;  // attitudes that tilt less than this apart are one
constexpr std::size_t kMaxAttitudes = 64;
// A carrier that moves less is at rest: the noise of its poses is as large, or it is a mast that
// sways, from which nearly the same is seen and hidden throughout.
constexpr float kMaxRestM = 0.05F;
constexpr float kMaxRestRad = 2.2F * static_cast<float>(M_PI) / 180.0F;

// A band is watched if it has this share of the mean of the bands within two degrees: what stands
// there makes some bands richer than others, but not by as much as beams those between them.
constexpr std::ptrdiff_t kBandsBeside = 20;
constexpr double kMinShareOfMean = 0.05;
constexpr double kLeastRangeM = 1e-6;  // what is nearer has no direction
constexpr std::uint32_t kMaxReturns = 1U << 30U;
// No two neighbouring beams are farther apart, which is 4.5 degrees at the horizon, and a wider
// strip of watched bands is no beam.
constexpr std::ptrdiff_t kMaxStep = 45;
constexpr std::ptrdiff_t kMaxBeam = 4;

// Returns the place of a ray among the bands, counted from the nadir.
double BandOf(const Eigen::Vector3d& ray_m, std::size_t num_bands) {
  const double range_m = std::max(ray_m.norm(), kLeastRangeM);
  return (1.0 + ray_m.z() / range_m) / 2.0 * static_cast<double>(num_bands);
}

}  // namespace

FieldOfView::FieldOfView() : lowest_(kNoneSeen), highest_(-kNoneSeen), sharp_rad_(kSharpRad) {
  lowest_of_.fill(lowest_);
  highest_of_.fill(highest_);
}

void FieldOfView::AddFrame(PointsView points_m, const CarrierPose& carrier) {
  if (!std::exchange(has_begun_, true)) first_carrier_ = carrier;
  is_carrier_moving_ = is_carrier_moving_ ||
                       (carrier.shift_m - first_carrier_.shift_m).norm() > kMaxRestM ||
                       first_carrier_.rotation.angularDistance(carrier.rotation) > kMaxRestRad;
  if (carrier.rotation.angularDistance(Eigen::Quaternionf::Identity()) > 0.0F) {
    sharp_rad_ = kSharpOfMovingRad;
  }
  const Eigen::Vector3f up = carrier.rotation * Eigen::Vector3f::UnitZ();
  const auto is_alike = [&](const Eigen::Vector3f& other) {
    return (up - other).norm() < kAlikeRad;
  };
  if (ups_.size() < kMaxAttitudes && std::none_of(ups_.begin(), ups_.end(), is_alike)) {
    ups_.push_back(up);
  }
  const Eigen::Matrix3f to_carrier = carrier.rotation.conjugate().toRotationMatrix();
  for (std::size_t i = 0; i < points_m.size(); ++i)
    Add(to_carrier * (points_m[i] - carrier.shift_m));
}

bool FieldOfView::Contains(const Eigen::Vector3f& ray_m) const {
  const float sine = ray_m.z() / ray_m.norm();
  return lowest_ <= sine && sine <= highest_ && columns_[AzimuthColumn(ray_m)];
}

void FieldOfView::Add(const Eigen::Vector3f& ray_m) {
  if (is_carrier_moving_) columns_[AzimuthColumn(ray_m)] = true;
  const float sine = ray_m.z() / ray_m.norm();
  lowest_ = std::min(lowest_, sine);
  highest_ = std::max(highest_, sine);
  // Conservative: angles differ by at least as much as their sines.
  const auto sharp = static_cast<float>(sharp_rad_);
  if (sine > lowest_ + sharp && sine < highest_ - sharp) return;
  const std::size_t column = AzimuthColumn(ray_m);
  lowest_of_[column] = std::min(lowest_of_[column], sine);
  highest_of_[column] = std::max(highest_of_[column], sine);
}

double FieldOfView::LowestRad() const {
  return lowest_ == kNoneSeen ? 0.0 : std::asin(static_cast<double>(lowest_));
}

ElevationRange FieldOfView::Edges() const {
  ElevationRange edges;
  const bool is_level = ups_.size() == 1 && ups_[0] == Eigen::Vector3f::UnitZ();
  if (!is_level) edges.ups = ups_;
  if (highest_ < lowest_) return edges;
  const auto elevation_rad = [](float sine) { return std::asin(static_cast<double>(sine)); };
  const auto is_sharp = [&](const std::array<float, kAzimuthColumns>& sines, float edge) {
    return std::count_if(sines.begin(), sines.end(), [&](float sine) {
             return std::abs(sine) < kNoneSeen &&
                    std::abs(elevation_rad(sine) - elevation_rad(edge)) < sharp_rad_;
           }) >= kMinColumns;
  };
  if (is_sharp(lowest_of_, lowest_)) edges.lowest_rad = elevation_rad(lowest_);
  if (is_sharp(highest_of_, highest_)) edges.highest_rad = elevation_rad(highest_);
  return edges;
}

double LowestElevationRad(const std::vector<Eigen::Vector3f>& points_m) {
  constexpr double kShare = 0.01;
  std::vector<float> sines(points_m.size());
  for (std::size_t i = 0; i < sines.size(); ++i) sines[i] = points_m[i].z() / points_m[i].norm();
  const auto k = static_cast<std::ptrdiff_t>(kShare * static_cast<double>(sines.size()));
  return std::asin(static_cast<double>(NthSmallest(sines.begin(), sines.end(), k)));
}

WatchedElevations::WatchedElevations() {
  std::iota(watched_below_.begin(), watched_below_.end(), 0.0F);
}

void WatchedElevations::AddFrame(PointsView points_m, const CarrierPose& carrier) {
  const Eigen::Vector3f up = carrier.rotation * Eigen::Vector3f::UnitZ();
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    const Eigen::Vector3f ray_m = points_m[i] - carrier.shift_m;
    const float range_m = ray_m.norm();
    if (range_m < kLeastRangeM) continue;
    const float share = (1.0F + up.dot(ray_m) / range_m) / 2.0F;
    const auto band = static_cast<std::size_t>(share * static_cast<float>(kBands));
    ++returns_[std::min(band, kBands - 1)];
  }
  num_returns_ += static_cast<std::uint32_t>(points_m.size());
  if (num_returns_ < kMaxReturns) return;
  for (std::uint32_t& returns : returns_) returns /= 2;
  num_returns_ /= 2;
}

void WatchedElevations::Update() {
  const auto num_bands = static_cast<std::ptrdiff_t>(kBands);
  for (std::ptrdiff_t band = 0; band < num_bands; ++band) {
    const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, band - kBandsBeside);
    const std::ptrdiff_t last = std::min(num_bands, band + kBandsBeside + 1);
    const double mean = std::accumulate(returns_.begin() + first, returns_.begin() + last, 0.0) /
                        static_cast<double>(last - first);
    const auto b = static_cast<std::size_t>(band);
    const bool is_watched = returns_[b] > 0 && returns_[b] > kMinShareOfMean * mean;
    watched_below_[b + 1] = watched_below_[b] + (is_watched ? 1.0F : 0.0F);
  }
  FindBeams();
}

// The step between two beams is that of all bands from one to the other. Beyond the outermost known
// ones, as in an empty sky, beams are as far apart as the nearest that are known.
void WatchedElevations::FindBeams() {
  const auto num_bands = static_cast<std::ptrdiff_t>(kBands);
  const auto is_watched = [this](std::ptrdiff_t band) {
    const auto b = static_cast<std::size_t>(band);
    return watched_below_[b + 1] > watched_below_[b];
  };
  constexpr float kUnknown = -1.0F;
  beam_steps_.fill(kUnknown);
  std::ptrdiff_t begin = 0;    // of the strip that is watched
  std::ptrdiff_t before = -1;  // middle of the one below
  for (std::ptrdiff_t end = 0; end <= num_bands; ++end) {
    if (end < num_bands && is_watched(end)) continue;
    if (end > begin) {
      const std::ptrdiff_t middle = (begin + end) / 2;
      const std::ptrdiff_t step = middle - before;
      if (end - begin > kMaxBeam) {
        std::fill(beam_steps_.begin() + begin, beam_steps_.begin() + end, 0.0F);
      } else if (before >= 0 && step <= kMaxStep) {
        std::fill(beam_steps_.begin() + before, beam_steps_.begin() + middle,
                  static_cast<float>(step));
      }
      before = middle;
    }
    begin = end + 1;
  }
  const auto first_known =
      std::find_if(beam_steps_.begin(), beam_steps_.end(), [](float step) { return step >= 0.0F; });
  float known = first_known == beam_steps_.end() ? 0.0F : *first_known;
  for (float& step : beam_steps_) {
    if (step < 0.0F) step = known;
    known = step;
  }
}

double WatchedElevations::Share(const Eigen::Vector3d& from_m, const Eigen::Vector3d& to_m) const {
  const auto below = [this](double bands) {
    const std::size_t band = std::min(static_cast<std::size_t>(bands), kBands - 1);
    const double first = watched_below_[band];
    return first + (bands - static_cast<double>(band)) * (watched_below_[band + 1] - first);
  };
  const double from = BandOf(from_m, kBands);
  const double to = BandOf(to_m, kBands);
  return to > from ? (below(to) - below(from)) / (to - from) : 1.0;
}

// Bands are of the sine of the elevation: across a ray they are as wide as they are high, over its
// cosine.
double WatchedElevations::BeamStepM(const Eigen::Vector3d& ray_m) const {
  const double level_m = std::max(ray_m.head<2>().norm(), kLeastRangeM);
  const auto band = static_cast<std::size_t>(BandOf(ray_m, kBands));
  const auto bands = static_cast<double>(beam_steps_[std::min(band, kBands - 1)]);
  return bands * 2.0 / static_cast<double>(kBands) * ray_m.squaredNorm() / level_m;
}

void SightDensity::AddFrame(PointsView points_m, const CarrierPose& carrier) {
  constexpr std::size_t kSampledReturns = 1000;
  constexpr float kMaxFrames = 65'536.0F;
  if (points_m.size() == 0) return;
  const Eigen::Matrix3f to_carrier = carrier.rotation.conjugate().toRotationMatrix();
  // Odd: a frame of a spinning sensor has its beams, a power of two, over and over.
  const std::size_t stride = (points_m.size() / kSampledReturns) | 1U;
  for (std::size_t i = 0; i < points_m.size(); i += stride) {
    const Eigen::Vector3f ray_m = to_carrier * (points_m[i] - carrier.shift_m);
    const auto band = static_cast<std::size_t>(BandOf(ray_m.cast<double>(), kBands));
    returns_[std::min(band, kBands - 1) * kAzimuthColumns + AzimuthColumn(ray_m)] +=
        static_cast<float>(stride);
  }
  num_frames_ += 1.0F;
  if (num_frames_ < kMaxFrames) return;
  for (float& returns : returns_) returns /= 2.0F;
  num_frames_ /= 2.0F;
}

// Beams may be up to two bands apart, and the field of view may end within a band: a cell counts
// with the one above or below it, whichever has more.
void SightDensity::Update() {
  constexpr double kSparseShare = 0.1;
  constexpr double kCellSr = 4.0 * M_PI / static_cast<double>(kBands * kAzimuthColumns);
  struct Cell {
    float of_pair;
    float own;
  };
  std::array<Cell, kBands * kAzimuthColumns> cells;
  double left = 0.0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const float below = i >= kAzimuthColumns ? returns_[i - kAzimuthColumns] : 0.0F;
    const float above = i + kAzimuthColumns < cells.size() ? returns_[i + kAzimuthColumns] : 0.0F;
    cells[i] = {returns_[i] + std::max(below, above), returns_[i]};
    left += kSparseShare * static_cast<double>(returns_[i]);
  }
  std::sort(cells.begin(), cells.end(), By(&Cell::of_pair));
  for (const Cell& cell : cells) {
    left -= static_cast<double>(cell.own);
    if (left > 0.0) continue;
    per_sr_ = num_frames_ > 0.0F ? static_cast<double>(cell.of_pair / num_frames_) / (2.0 * kCellSr)
                                 : 0.0;
    return;
  }
}

}  // namespace unlidar
