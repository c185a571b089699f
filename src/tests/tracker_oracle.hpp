// The tracker's model once more, written from its description and sharing no code with it.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "tests/synthetic_plots.hpp"
#include "tracking/track_model.hpp"
#include "tracking/track_search.hpp"
#include "tracking/tracker.hpp"

namespace unlidar::testing {

// What each of all the plots brings as the first of a path: the chance that a target that appears
// somewhere is seen there, against the clutter of the place, in part the same for all of them, in
// units of its mean over the plots.
inline std::vector<double> PlainLogBirths(const std::vector<Plot>& plots,
                                          const TrackerConfig& config) {
  std::vector<double> odds;
  double mean = 0.0;
  for (const Plot& plot : plots) {
    const double returns =
        config.return_rate_m2_per_s * kPeriodS / std::max(1.0, plot.position_m.squaredNorm());
    // A gamma distribution of the mean of a Poisson process.
    const double unseen = std::pow(1.0 + returns / kReturnRateShape, -kReturnRateShape);
    odds.push_back((1.0 - unseen) / std::exp(plot.log_clutter));
    mean += odds.back() / static_cast<double>(plots.size());
  }
  const double uniform = config.uniform_birth_share;
  for (double& odd : odds) odd = std::log(uniform + (1.0 - uniform) * odd / mean);
  return odds;
}

// As plainly as can be: a Kalman filter of nine states (x, y, z, their
// velocities, their accelerations), Singer's model integrated numerically, all densities in full.
class PlainModel {
 public:
  using Vector9 = Eigen::Matrix<double, 9, 1>;
  using Matrix9 = Eigen::Matrix<double, 9, 9>;

  PlainModel(const TrackerConfig& config, double sigma_a_mps2, double birth_speed_mps,
             int num_sensors = 1)
      : config_(config),
        sigma_a_(sigma_a_mps2),
        birth_speed_(birth_speed_mps),
        num_sensors_(num_sensors) {}

  // Log likelihood ratio of a sequence of plots; minus infinity for one that is too fast, or that a
  // search deletes (`is_searched`).
  double Score(const std::vector<Plot>& plots, const std::vector<double>& log_births,
               bool is_searched, TimeOutOfView time_out_of_view) const {
    constexpr double kNever = -std::numeric_limits<double>::infinity();
    if (is_searched && log_births.front() < kDeletionLog) return kNever;
    Vector9 x = Vector9::Zero();
    x.head<3>() = plots.front().position_m;
    Matrix9 p = Matrix9::Zero();
    p.diagonal().segment<3>(0).setConstant(plots.front().variance_m2);
    p.diagonal().segment<3>(3).setConstant(birth_speed_ * birth_speed_);
    p.diagonal().segment<3>(6).setConstant(sigma_a_ * sigma_a_);
    // Back to the middle of the frame at a velocity of which nothing is known yet.
    Matrix9 back = Matrix9::Identity();
    back.block<3, 3>(0, 3) = -OffsetS(plots.front()) * Eigen::Matrix3d::Identity();
    p = back * p * back.transpose();
    double score = log_births.front();
    // The gamma distribution of how many returns it gives, as far as is known by now.
    double shape = kReturnRateShape;
    double rate = kReturnRateShape / config_.return_rate_m2_per_s;
    for (std::size_t k = 1; k < plots.size(); ++k) {
      const Plot& plot = plots[k];
      const double dt = static_cast<double>(plot.frame_time_ns - plots[k - 1].frame_time_ns) * 1e-9;
      const double per_frame = kPeriodS / std::max(1.0, x.head<3>().squaredNorm());
      const double missed = std::round(dt / kPeriodS) - 1.0;
      if (plot.sensor != plots[k - 1].sensor) {
        // How often one sensor saw it tells nothing of another.
        shape = kReturnRateShape;
        rate = kReturnRateShape / config_.return_rate_m2_per_s;
      }
      // Of a target that another sensor sees next nothing is known that could be out of view.
      const bool may_be_out_of_view = time_out_of_view == TimeOutOfView::kLogUniform &&
                                      plot.sensor == plots[k - 1].sensor && missed > 0.0;
      const double out_of_view =
          may_be_out_of_view ? config_.out_of_view_probability /
                                   (missed * (std::log(config_.max_gap_s / kPeriodS) + 0.5772))
                             : 0.0;
      const double unseen =
          std::max(out_of_view, std::pow(rate / (rate + missed * per_frame), shape));
      const double seen = 1.0 - std::pow(rate / (rate + per_frame), shape);
      score += std::log(unseen);
      if (is_searched && score < kDeletionLog) return kNever;
      score += std::log(seen) - plot.log_clutter;
      score += std::log(SensorShare(plots[k - 1].sensor, plot.sensor));
      shape += 1.0;
      rate += per_frame * (missed + 1.0);

      const double speed = std::min(config_.max_speed_mps, x.segment<3>(3).norm());
      const double streak = speed * plot.streak_s;
      const auto n = static_cast<double>(plot.num_returns);
      const Eigen::Matrix3d noise =
          (plot.variance_m2 + streak * streak / 12.0 / n / 3.0) * Eigen::Matrix3d::Identity();
      const Update steady = Updated(x, p, sigma_a_, dt, plot, noise);
      Update agile = Updated(x, p, kManoeuvreFactor * sigma_a_, dt, plot, noise);
      agile.log_density += config_.manoeuvre_log_probability;
      const Update& better = agile.log_density > steady.log_density ? agile : steady;
      score += better.log_density;
      const double least = std::max(kDeletionLog, log_births[k] + kReinitiationLog);
      if (is_searched && score < least) return kNever;
      x = better.x;
      p = better.p;
      if (x.segment<3>(3).norm() > config_.max_speed_mps) return kNever;
    }
    return score;
  }

 private:
  // The chance that the one of all sensors which sees it next is `to`.
  double SensorShare(std::uint32_t from, std::uint32_t to) const {
    const double change = num_sensors_ > 1 ? kSensorSwitchProbability : 0.0;
    return from == to ? 1.0 - change : change / (num_sensors_ - 1);
  }

  struct Update {
    Vector9 x;
    Matrix9 p;
    double log_density;
  };

  static double OffsetS(const Plot& plot) {
    return static_cast<double>(plot.time_ns - plot.frame_time_ns) * 1e-9;
  }

  Update Updated(Vector9 x, Matrix9 p, double sigma_a_mps2, double dt, const Plot& plot,
                 const Eigen::Matrix3d& noise) const {
    Integrate(dt, sigma_a_mps2, &x, &p);
    Eigen::Matrix<double, 3, 9> h = Eigen::Matrix<double, 3, 9>::Zero();
    h.leftCols<3>().setIdentity();
    h.block<3, 3>(0, 3) = OffsetS(plot) * Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d s = h * p * h.transpose() + noise;
    const Eigen::Vector3d innovation = plot.position_m - h * x;
    const Eigen::Matrix<double, 9, 3> gain = p * h.transpose() * s.inverse();
    return {x + gain * innovation, (Matrix9::Identity() - gain * h) * p,
            -0.5 * innovation.dot(s.ldlt().solve(innovation)) -
                0.5 * std::log((2.0 * M_PI * s).determinant())};
  }

  // x' = A x with white noise on the accelerations, which keeps their variance at sigma_a^2 in the
  // long run; Runge and Kutta's fourth order.
  void Integrate(double dt, double sigma_a_mps2, Vector9* x, Matrix9* p) const {
    const double tau = kSearchAccelerationTimeS;
    Matrix9 a = Matrix9::Zero();
    a.block<3, 3>(0, 3).setIdentity();
    a.block<3, 3>(3, 6).setIdentity();
    a.block<3, 3>(6, 6) = -Eigen::Matrix3d::Identity() / tau;
    Matrix9 q = Matrix9::Zero();
    q.diagonal().tail<3>().setConstant(2.0 * sigma_a_mps2 * sigma_a_mps2 / tau);
    const auto x_rate = [&](const Vector9& v) -> Vector9 { return a * v; };
    const auto p_rate = [&](const Matrix9& m) -> Matrix9 { return a * m + m * a.transpose() + q; };
    // The noise of a short gap grows with its fifth power, which one step does not follow.
    const int steps = 5 + static_cast<int>(dt / 0.1);
    const double h = dt / steps;
    for (int i = 0; i < steps; ++i) {
      Step(x_rate, h, x);
      Step(p_rate, h, p);
    }
  }

  template <class Rate, class Value>
  static void Step(const Rate& rate, double h, Value* value) {
    const Value k1 = rate(*value);
    const Value k2 = rate(*value + 0.5 * h * k1);
    const Value k3 = rate(*value + 0.5 * h * k2);
    const Value k4 = rate(*value + h * k3);
    *value += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }

  const TrackerConfig& config_;
  double sigma_a_;
  double birth_speed_;
  int num_sensors_;
};

// The score of a path at the agility and birth speed that suit it best.
inline double PlainScore(const std::vector<Plot>& plots, const std::vector<std::uint32_t>& path,
                         const TrackerConfig& config, int num_sensors = 1, bool is_searched = false,
                         TimeOutOfView time_out_of_view = TimeOutOfView::kNone) {
  const std::vector<Plot> members = Members(plots, path);
  const std::vector<double> all_births = PlainLogBirths(plots, config);
  std::vector<double> log_births;
  for (const std::uint32_t i : path) log_births.push_back(all_births[i]);
  double best = -std::numeric_limits<double>::infinity();
  for (const double sigma_a_mps2 : config.sigma_a_mps2) {
    for (const double speed_mps : config.birth_speeds_mps) {
      const PlainModel model(config, sigma_a_mps2, speed_mps, num_sensors);
      best = std::max(best, model.Score(members, log_births, is_searched, time_out_of_view));
    }
  }
  return best;
}

}  // namespace unlidar::testing
