#include "scene/plots.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <tuple>

#include "base/algorithms.hpp"

namespace unlidar {
namespace {

// Linkage radius of a body: looser than that of a plot, as head and legs are hit separately.
constexpr RangeRadius kBodyLink{1.5, 0.02};
// People and vehicles reach down to this height above the ground, with this many returns: one or
// two may be strays.
constexpr double kBodyContactM = 1.0;
constexpr int kMinContactReturns = 3;
// Strays that may lie within the linkage radius of a return: at 2.7 they form chains without end
// (continuum percolation in space). Their rate is taken at so many returns of a group.
constexpr double kMaxStraysLinked = 0.5;
constexpr std::size_t kMaxSampledReturns = 8;
// Returns from which the width of a body can be estimated.
constexpr int kMinSpreadReturns = 6;
// The lower edge of the field of view cuts off legs: a return within a few rays of it, and no
// higher than a person, counts as ground contact.
constexpr double kBodyEdgeRad = 0.05;
// Where no ground is in view the station may stand on it, and a body reaches down to the very edge
// of the view: other returns may all be higher than a drone.
constexpr double kBodyUnknownEdgeRad = 0.01;
// Plots nearer to the box of a body than this share of its size (at least kMinBodyMarginM) are part
// of it: its far side is hidden, the rest sparse.
constexpr double kBodyMargin = 0.5;
constexpr double kMinBodyMarginM = 0.75;
// Roughness of the ground: lower returns are not legs.
constexpr double kRoughnessM = 0.25;

double ElevationRad(const Eigen::Vector3f& ray_m) {
  return std::asin(static_cast<double>(ray_m.z() / ray_m.norm()));
}

// True if a return is at the ground, or where the field of view may cut off what reaches there.
bool IsAtGround(const Eigen::Vector3f& ray_m, const FrameInfo& frame, const Ground& ground,
                const LowestElevations& lowest) {
  const double height_m = ground.HeightAbove(ray_m + frame.carrier.shift_m);
  if (height_m < kBodyContactM) return true;
  if (std::isfinite(height_m)) {
    return height_m < kPersonHeightM &&
           ElevationRad(ray_m) < lowest.above_ground_rad + kBodyEdgeRad;
  }
  return static_cast<double>(ray_m.z()) < kPersonHeightM &&
         ElevationRad(frame.carrier.rotation.conjugate() * ray_m) <
             lowest.of_view_rad + kBodyUnknownEdgeRad;
}

bool IsBody(const Recording& recording, const FrameInfo& frame, const IndexView& returns,
            const Ground& ground, const LowestElevations& lowest, const PlotConfig& config) {
  const int n = static_cast<int>(returns.size());
  if (n >= kMinContactReturns) {
    const auto is_at_ground = [&](std::uint32_t i) {
      return IsAtGround(recording.points_m[i], frame, ground, lowest);
    };
    if (std::any_of(returns.begin(), returns.end(), is_at_ground)) return true;
  }
  if (n < kMinSpreadReturns) return false;
  const Eigen::Vector3d mean = MeanOf(recording, returns);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const std::uint32_t i : returns) {
    const Eigen::Vector3d d = recording.points_m[i].cast<double>() - mean;
    covariance += d * d.transpose() / n;
  }
  // The second axis, not the first: a fast target leaves a streak in one direction.
  const Eigen::Vector3d variances =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly)
          .eigenvalues();
  return variances[1] > config.body_spread_m * config.body_spread_m;
}

}  // namespace

void SortByFrameTime(std::vector<Plot>* plots) {
  const auto is_before = By(&Plot::frame_time_ns);
  // Sorting takes memory for half of the plots, and they are mostly in order.
  if (std::is_sorted(plots->begin(), plots->end(), is_before)) return;
  std::stable_sort(plots->begin(), plots->end(), is_before);
}

void Columns::Add(const Plot& plot) {
  constexpr double kRoundingM = 0.01;  // of coordinates in float
  const double radius_m = kColumnRadius.At(plot.ray_m.norm());
  columns_.push_back({plot.position_m.x(), radius_m, &plot, columns_.size()});
  const Eigen::Vector3d across_m(radius_m + kRoundingM, radius_m + kRoundingM, 0.0);
  const Eigen::Vector3d down_m(0.0, 0.0, std::max(plot.column_m, 0.0F) + kRoundingM);
  box_.extend((plot.position_m + across_m).cast<float>());
  box_.extend((plot.position_m - across_m - down_m).cast<float>());
}

void Columns::Sort() {
  std::sort(columns_.begin(), columns_.end(), [](const Column& a, const Column& b) {
    return std::tie(a.x_m, a.number) < std::tie(b.x_m, b.number);
  });
  widest_m_ = 0.0;
  for (const Column& column : columns_) widest_m_ = std::max(widest_m_, column.radius_m);
}

// Counts the returns below each plot, including structure: near the ground, legs may be taken for
// structure.
void FramePlotter::CountBelow(const Recording& recording, const FrameInfo& frame) {
  columns_.Clear();
  for (const Plot& plot : found_.plots) columns_.Add(plot);
  columns_.Sort();
  for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
    columns_.VisitAbove(recording.points_m[i],
                        [&](std::size_t number) { ++found_.plots[number].num_below; });
  }
}

// Counts the returns in line with the empty column below each low plot: what is before it hides
// what may be there.
void FramePlotter::CountInLineBelow(const Recording& recording, const FrameInfo& frame,
                                    double off_ground_m) {
  sights_.clear();
  for (Plot& plot : found_.plots) {
    if (plot.num_below > 0 || plot.lowest_m > off_ground_m || plot.column_m <= kBelowPlotM)
      continue;
    const Eigen::Vector3f ray_m = plot.ray_m.cast<float>();
    const float range_m = ray_m.head<2>().norm();
    const auto radius_m = static_cast<float>(kColumnRadius.At(plot.ray_m.norm()));
    sights_.push_back({&plot, ray_m.head<2>() / range_m, range_m, radius_m,
                       (ray_m.z() - plot.column_m) / range_m,
                       (ray_m.z() - static_cast<float>(kBelowPlotM)) / range_m});
  }
  if (sights_.empty()) return;
  for (std::uint32_t i = frame.first_return; i < frame.last_return; ++i) {
    const Eigen::Vector3f& p = recording.points_m[i];
    for (const Sight& sight : sights_) {
      const float along_m = p.head<2>().dot(sight.toward);
      const float across_m = p.x() * sight.toward.y() - p.y() * sight.toward.x();
      if (std::abs(across_m) * sight.range_m >= sight.radius_m * along_m) continue;
      if (p.z() <= sight.lowest * along_m || p.z() >= sight.highest * along_m) continue;
      if (along_m < sight.range_m - sight.radius_m) ++sight.plot->num_before_below;
      if (along_m > sight.range_m + sight.radius_m) ++sight.plot->num_behind_below;
    }
  }
}

// Returns the linkage radius of bodies at which strays seldom join the returns of a group:
// kBodyLink, or less where the air is full of them.
RangeRadius FramePlotter::BodyLinkAmongStrays(const Recording& recording, const IndexView& returns,
                                              const StrayRateAt& stray_rate_at) const {
  const std::size_t step = (returns.size() - 1) / kMaxSampledReturns + 1;
  StrayRate num_strays;  // within kBodyLink
  double num_sampled = 0.0;
  for (std::size_t k = 0; k < returns.size(); k += step) {
    const Eigen::Vector3f& point_m = recording.points_m[returns.begin()[k]];
    const double radius_m = kBodyLink.At(static_cast<double>(point_m.norm()));
    const double volume_m3 = 4.0 / 3.0 * M_PI * std::pow(radius_m, 3);
    const StrayRate rate = stray_rate_at(point_m);
    num_strays.usual += volume_m3 * rate.usual;
    num_strays.present += volume_m3 * rate.present;
    num_sampled += 1.0;
  }
  const double most = std::max(num_strays.usual, num_strays.present);
  const double factor = std::cbrt(std::min(1.0, kMaxStraysLinked * num_sampled / most));
  return {factor * kBodyLink.constant_m, factor * kBodyLink.slope};
}

void FramePlotter::AddBody(const Recording& recording, std::uint32_t first_return,
                           const IndexView& returns) {
  const Eigen::Array3f first = recording.points_m[returns.front()].array();
  BodyBox box{recording.times_ns[returns.front()], first, first};
  for (const std::uint32_t i : returns) {
    is_body_[i - first_return] = 1;
    box.low_m = box.low_m.min(recording.points_m[i].array());
    box.high_m = box.high_m.max(recording.points_m[i].array());
  }
  found_.body_returns.insert(found_.body_returns.end(), returns.begin(), returns.end());
  found_.bodies.push_back(box);
}

FramePlots& FramePlotter::Find(const Recording& recording, std::uint32_t frame_index,
                               std::vector<std::uint32_t>* candidates, const Ground& ground,
                               const LowestElevations& lowest, const StrayRateAt& stray_rate_at,
                               const RobustConfig& config) {
  const FrameInfo& frame = recording.frames[frame_index];
  found_.plots.clear();
  found_.bodies.clear();
  found_.body_returns.clear();
  if (candidates->empty()) return found_;
  is_body_.assign(frame.last_return - frame.first_return, 0);
  linker_.Link(recording.points_m, *candidates, kBodyLink);
  for (std::size_t g = 0; config.Uses(Rule::kBodies) && g < linker_.size(); ++g) {
    const IndexView body = linker_[g];
    if (!IsBody(recording, frame, body, ground, lowest, config.plots)) continue;
    const RangeRadius link = BodyLinkAmongStrays(recording, body, stray_rate_at);
    if (link.constant_m == kBodyLink.constant_m) {
      AddBody(recording, frame.first_return, body);
      continue;
    }
    group_.assign(body.begin(), body.end());
    body_linker_.Link(recording.points_m, group_, link);
    for (std::size_t k = 0; k < body_linker_.size(); ++k) {
      if (IsBody(recording, frame, body_linker_[k], ground, lowest, config.plots)) {
        AddBody(recording, frame.first_return, body_linker_[k]);
      }
    }
  }
  EraseIf(candidates, [&](std::uint32_t i) { return is_body_[i - frame.first_return] != 0; });
  linker_.Link(recording.points_m, *candidates, config.plots.link);
  for (std::size_t g = 0; g < linker_.size(); ++g) {
    const IndexView returns = linker_[g];
    Plot plot;
    plot.frame = frame_index;
    plot.sensor = frame.sensor;
    plot.frame_time_ns = frame.middle_ns();
    plot.streak_s = frame.is_timed ? 0.0 : SecondsOf(frame.end_ns - frame.begin_ns);
    plot.time_sigma_s = frame.time_sigma_s;
    plot.ray_m = plot.position_m = MeanOf(recording, returns);
    const double beam_m = config.plots.noise_per_range * plot.position_m.norm();
    plot.variance_m2 =
        Square(config.plots.noise_m) +
        Square(config.plots.noise_per_return_m) / static_cast<double>(returns.size()) +
        Square(beam_m);
    plot.shift_m = frame.carrier.shift_m;
    plot.carrier_ray_m = frame.carrier.rotation.conjugate() * plot.ray_m.cast<float>();
    plot.column_m =
        static_cast<float>(ground.HeightAbove(plot.PlaceM().cast<float>()) - kRoughnessM);
    TimeNs time_sum = 0;
    plot.lowest_m = std::numeric_limits<double>::infinity();
    for (const std::uint32_t i : returns) {
      const Eigen::Vector3f place_m = recording.points_m[i] + plot.shift_m;
      plot.lowest_m = std::min(plot.lowest_m, ground.HeightAbove(place_m));
      time_sum += recording.times_ns[i] - frame.begin_ns;
    }
    plot.time_ns = frame.begin_ns + time_sum / static_cast<TimeNs>(returns.size());
    plot.num_returns = static_cast<std::uint32_t>(returns.size());
    found_.plots.push_back(plot);
  }
  CountBelow(recording, frame);
  CountInLineBelow(recording, frame, config.off_ground_m);
  return found_;
}

bool IsNearBody(const Plot& plot, const Queue<BodyBox>& bodies) {
  const auto margin_ns = NsOf(kBodyMarginS);
  const Eigen::Array3f p = plot.position_m.cast<float>().array();
  auto body = FirstFrom(bodies, &BodyBox::time_ns, plot.time_ns - margin_ns);
  for (; body != bodies.end() && body->time_ns <= plot.time_ns + margin_ns; ++body) {
    // The hidden far side may extend by a share of the length, the top by one of the height.
    const Eigen::Array3f size_m = body->high_m - body->low_m;
    const float length_m = size_m.head<2>().maxCoeff();
    const Eigen::Array3f margin_m =
        (static_cast<float>(kBodyMargin) * Eigen::Array3f(length_m, length_m, size_m.z()))
            .max(static_cast<float>(kMinBodyMarginM));
    if ((p > body->low_m - margin_m).all() && (p < body->high_m + margin_m).all()) return true;
  }
  return false;
}

}  // namespace unlidar
