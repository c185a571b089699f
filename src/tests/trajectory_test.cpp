#include "trajectory/trajectory.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tests/draws.hpp"
#include "tests/fit_trajectory.hpp"
#include "trajectory/spline_model.hpp"
#include "trajectory/trajectory_fitter.hpp"

namespace unlidar {
namespace {

using Path = std::function<Eigen::Vector3d(double)>;

constexpr TimeNs kBeginNs = 1'706'255'054'000'000'001;

TimeNs Stamp(double time_s) { return kBeginNs + static_cast<TimeNs>(std::llround(time_s * 1e9)); }

class Random {
 public:
  explicit Random(std::uint64_t seed) : generator_(seed) {}
  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(generator_() >> 11) * 0x1p-53;
  }
  Eigen::Vector3d Normal() {
    return Eigen::Vector3d::NullaryExpr([&] {
      return std::sqrt(-2.0 * std::log(Uniform(1e-300, 1.0))) *
             std::cos(2.0 * M_PI * Uniform(0.0, 1.0));
    });
  }

 private:
  std::mt19937_64 generator_;
};

Measurement At(double time_s, const Eigen::Vector3d& position_m, double sigma_m) {
  Measurement measurement;
  measurement.time_ns = Stamp(time_s);
  measurement.position_m = position_m;
  measurement.covariance_m2 = sigma_m * sigma_m * Eigen::Matrix3d::Identity();
  return measurement;
}

// Noise of sigma_m; times at random, rate_hz of them a second.
std::vector<Measurement> Measure(const Path& path, double duration_s, double rate_hz,
                                 double sigma_m, Random& random) {
  std::vector<double> times_s;
  for (int i = 0; i < static_cast<int>(duration_s * rate_hz); ++i) {
    times_s.push_back(random.Uniform(0.0, duration_s));
  }
  std::sort(times_s.begin(), times_s.end());
  std::vector<Measurement> measurements;
  for (const double time_s : times_s) {
    measurements.push_back(At(time_s, path(time_s) + sigma_m * random.Normal(), sigma_m));
  }
  return measurements;
}

// Sum of six slow waves with given rms speed and acceleration.
Path Wander(double speed_mps, double acceleration_mps2, Random& random) {
  struct Wave {
    double rate;
    Eigen::Vector3d sine, cosine;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 6; ++i) {
    const double rate = acceleration_mps2 / speed_mps * random.Uniform(0.2, 1.3);
    const double size_m = speed_mps / rate / 3.0;
    waves.push_back({rate, size_m * random.Normal(), size_m * random.Normal()});
  }
  return [waves](double time_s) {
    Eigen::Vector3d position_m(3.0, -20.0, 15.0);
    for (const auto& wave : waves) {
      position_m +=
          wave.sine * std::sin(wave.rate * time_s) + wave.cosine * std::cos(wave.rate * time_s);
    }
    return position_m;
  };
}

Path Circle(double speed_mps, double acceleration_mps2) {
  const double rate = acceleration_mps2 / speed_mps;
  return [=](double t) {
    return Eigen::Vector3d(speed_mps / rate * std::cos(rate * t),
                           speed_mps / rate * std::sin(rate * t), 10.0 + 0.3 * t);
  };
}

Path Line() {
  return [](double t) { return Eigen::Vector3d(-40.0 + 4.0 * t, 12.0 - 20.0 * t, 20.0 + 0.5 * t); };
}

double LargestShift(const Trajectory& a, const Trajectory& b, double duration_s) {
  double largest_m = 0.0;
  for (double t = 0.0; t <= duration_s; t += 0.05) {
    largest_m = std::max(largest_m, (a.At(Stamp(t)).position_m - b.At(Stamp(t)).position_m).norm());
  }
  return largest_m;
}

void ExpectFinite(const Trajectory& trajectory) {
  const double end_s = static_cast<double>(trajectory.end_ns() - kBeginNs) * 1e-9;
  for (double t = -6.0; t <= end_s + 6.0; t += (end_s + 12.0) / 100.0) {
    const TrajectoryRow row = trajectory.At(Stamp(t));
    EXPECT_TRUE(row.position_m.allFinite() && row.velocity_mps.allFinite() &&
                row.sigma_m.allFinite());
    EXPECT_GT(row.sigma_m.minCoeff(), 0.0);
  }
}

TEST(Trajectory, AStraightLineIsReproduced) {
  Random random(1);
  const auto measurements = [&] {
    auto exact = Measure(Line(), 30.0, 10.0, 0.1, random);
    for (auto& m : exact) {
      m.position_m = Line()(static_cast<double>(m.time_ns - kBeginNs) * 1e-9);
    }
    return exact;
  }();
  const Trajectory trajectory = FitTrajectory(measurements, {});
  for (double t = 0.2; t < 29.8; t += 0.05) {
    const TrajectoryRow row = trajectory.At(Stamp(t));
    EXPECT_LT((row.position_m - Line()(t)).norm(), 1e-6);
    EXPECT_LT((row.velocity_mps - Eigen::Vector3d(4.0, -20.0, 0.5)).norm(), 1e-5);
  }
  EXPECT_TRUE(trajectory.minimum.converged);
}

TEST(Trajectory, OneOutlierOf20MetresMovesItByLessThan5Centimetres) {
  for (const double rate_hz : {2.0, 10.0}) {
    Random random(2);
    const auto clean = Measure(Wander(5.0, 2.0, random), 20.0, rate_hz, 0.05, random);
    const Trajectory before = FitTrajectory(clean, {});
    for (std::size_t i = 3; i + 3 < clean.size(); i += clean.size() / 8) {
      auto spoilt = clean;
      auto outlier = clean[i];
      outlier.time_ns += 1'000'000;
      outlier.position_m += Eigen::Vector3d(12.0, 0.0, 16.0);
      spoilt.insert(spoilt.begin() + static_cast<std::ptrdiff_t>(i) + 1, outlier);
      const Trajectory after = FitTrajectory(spoilt, {});
      EXPECT_LT(LargestShift(before, after, 20.0), 0.05) << rate_hz << " Hz, " << i;
      EXPECT_EQ(after.weights[i + 1], 0.0);
    }
  }
}

TEST(Trajectory, AnOutlierThatStandsAloneIsLeftOut) {
  // At 1 Hz the spline could well bend through it.
  Random random(17);
  const Path path = Wander(5.0, 2.0, random);
  for (int i = 5; i < 25; i += 3) {
    std::vector<Measurement> clean, spoilt;
    for (int second = 0; second < 30; ++second) {
      auto measurement = At(second, path(second) + 0.1 * random.Normal(), 0.1);
      if (second != i) clean.push_back(measurement);
      if (second == i) measurement.position_m += Eigen::Vector3d(12.0, 0.0, 16.0);
      spoilt.push_back(measurement);
    }
    EXPECT_LT(LargestShift(FitTrajectory(clean, {}), FitTrajectory(spoilt, {}), 29.0), 0.05) << i;
  }
}

TEST(Trajectory, ATenthOfOutliersMovesItByLittle) {
  Random random(3);
  const auto clean = Measure(Wander(5.0, 2.0, random), 20.0, 10.0, 0.05, random);
  auto spoilt = clean;
  for (std::size_t i = 0; i < 20; ++i) {
    auto outlier = clean[10 * i + i % 7];
    outlier.position_m += random.Uniform(1.0, 20.0) * random.Normal().normalized();
    spoilt.push_back(outlier);
  }
  std::stable_sort(spoilt.begin(), spoilt.end(), [](const Measurement& a, const Measurement& b) {
    return a.time_ns < b.time_ns;
  });
  EXPECT_LT(LargestShift(FitTrajectory(clean, {}), FitTrajectory(spoilt, {}), 20.0), 0.05);
}

TEST(Trajectory, SigmaWidensAcrossAGapAndBeyondTheEnds) {
  Random random(4);
  auto measurements = Measure(Wander(5.0, 2.0, random), 20.0, 10.0, 0.1, random);
  measurements.erase(std::remove_if(measurements.begin(), measurements.end(),
                                    [](const Measurement& m) {
                                      return m.time_ns > Stamp(10.0) && m.time_ns < Stamp(12.5);
                                    }),
                     measurements.end());
  const Trajectory trajectory = FitTrajectory(measurements, {});
  const auto sigma_m = [&](double t) { return trajectory.At(Stamp(t)).sigma_m.maxCoeff(); };
  EXPECT_LT(sigma_m(5.0), 0.1);
  EXPECT_GT(sigma_m(11.25), 3.0 * sigma_m(5.0));
  EXPECT_GT(sigma_m(11.25), sigma_m(10.5));
  EXPECT_GT(sigma_m(11.25), sigma_m(12.0));
  EXPECT_GT(sigma_m(20.0), sigma_m(15.0));
  for (double t = 20.0; t < 25.0; t += 0.5) EXPECT_GT(sigma_m(t + 0.5), sigma_m(t));
  for (double t = 0.0; t > -5.0; t -= 0.5) EXPECT_GT(sigma_m(t - 0.5), sigma_m(t));
}

// Kalman filter and Rauch-Tung-Striebel smoother of the same model, at the times of the
// measurements and of the queries. acceleration: its standard deviations at a time, a symmetric
// matrix.
struct Smoothed {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
};

std::vector<Smoothed> SmoothWithKalman(const std::vector<double>& times_s,
                                       const std::vector<std::optional<Eigen::Vector3d>>& values,
                                       double noise,
                                       const std::function<Eigen::Matrix3d(double)>& acceleration,
                                       double begin_acceleration, double tau_s) {
  using State = Eigen::Matrix<double, 9, 1>;  // position, velocity, acceleration
  using Covariance = Eigen::Matrix<double, 9, 9>;
  using Column = Eigen::Matrix<double, 9, 3>;
  const auto transition = [&](double dt_s) {
    const double decay = std::exp(-dt_s / tau_s);
    Covariance f = Covariance::Identity();
    f.block<3, 3>(0, 3).diagonal().setConstant(dt_s);
    f.block<3, 3>(0, 6).diagonal().setConstant(tau_s * tau_s * (dt_s / tau_s - 1.0 + decay));
    f.block<3, 3>(3, 6).diagonal().setConstant(tau_s * (1.0 - decay));
    f.block<3, 3>(6, 6).diagonal().setConstant(decay);
    return f;
  };
  const auto process_noise = [&](double end_s, double dt_s) {
    Covariance q = Covariance::Zero();
    constexpr int kSteps = 400;
    for (int i = 0; i < kSteps; ++i) {
      const double before_end_s = dt_s * (i + 0.5) / kSteps;
      const Column g = transition(before_end_s).rightCols<3>() * acceleration(end_s - before_end_s);
      q += 2.0 / tau_s * dt_s / kSteps * g * g.transpose();
    }
    return q;
  };
  const std::size_t n = times_s.size();
  std::vector<State> mean(n), predicted(n);
  std::vector<Covariance> covariance(n), predicted_covariance(n), step(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (i == 0) {
      predicted[0].setZero();
      State variances;
      variances << Eigen::Vector3d::Constant(1e8), Eigen::Vector3d::Constant(1e7),
          Eigen::Vector3d::Constant(begin_acceleration * begin_acceleration);
      predicted_covariance[0] = variances.asDiagonal();
    } else {
      const double dt_s = times_s[i] - times_s[i - 1];
      step[i] = transition(dt_s);
      predicted[i] = step[i] * mean[i - 1];
      predicted_covariance[i] =
          step[i] * covariance[i - 1] * step[i].transpose() + process_noise(times_s[i], dt_s);
    }
    mean[i] = predicted[i];
    covariance[i] = predicted_covariance[i];
    if (values[i]) {
      const Eigen::Matrix3d innovation = predicted_covariance[i].topLeftCorner<3, 3>() +
                                         noise * noise * Eigen::Matrix3d::Identity();
      const Column gain = predicted_covariance[i].leftCols<3>() * innovation.inverse();
      mean[i] += gain * (*values[i] - predicted[i].head<3>());
      Covariance keep = Covariance::Identity();
      keep.leftCols<3>() -= gain;
      covariance[i] = keep * predicted_covariance[i] * keep.transpose() +
                      noise * noise * gain * gain.transpose();
    }
  }
  for (std::size_t i = n - 1; i-- > 0;) {
    const Covariance gain =
        covariance[i] * step[i + 1].transpose() * predicted_covariance[i + 1].inverse();
    mean[i] += gain * (mean[i + 1] - predicted[i + 1]);
    covariance[i] += gain * (covariance[i + 1] - predicted_covariance[i + 1]) * gain.transpose();
  }
  std::vector<Smoothed> smoothed(n);
  for (std::size_t i = 0; i < n; ++i) {
    smoothed[i] = {mean[i].head<3>(), covariance[i].diagonal().head<3>().cwiseSqrt()};
  }
  return smoothed;
}

TEST(Trajectory, MeanAndSigmaAreThoseOfAKalmanSmootherWithTheSamePrior) {
  struct Flight {
    double speed, acceleration, rate_hz, noise, gap_s;
  };
  for (const Flight& flight :
       {Flight{0.1, 0.1, 10.0, 0.1, 0.0}, Flight{5.0, 2.0, 10.0, 0.1, 2.5},
        Flight{20.0, 10.0, 10.0, 0.05, 1.0}, Flight{20.0, 10.0, 1.0, 0.2, 0.0},
        Flight{20.0, 30.0, 100.0, 0.05, 0.0}}) {
    Random random(5);
    auto measurements = Measure(Wander(flight.speed, flight.acceleration, random), 15.0,
                                flight.rate_hz, flight.noise, random);
    const TimeNs gap_ns = Stamp(6.0 + flight.gap_s);
    measurements.erase(std::remove_if(measurements.begin(), measurements.end(),
                                      [&](const Measurement& m) {
                                        return m.time_ns > Stamp(6.0) && m.time_ns < gap_ns;
                                      }),
                       measurements.end());
    // Stated noise above the true one leaves no outliers: the oracle is not robust.
    const double noise = 4.0 * flight.noise;
    for (Measurement& m : measurements) {
      m.covariance_m2 = noise * noise * Eigen::Matrix3d::Identity();
    }
    const TrajectoryScales scales{flight.acceleration, 1.0, 2.0};
    const Trajectory trajectory = RefitTrajectory(measurements, scales, {});
    EXPECT_EQ(*std::min_element(trajectory.weights.begin(), trajectory.weights.end()), 1.0);
    struct Event {
      TimeNs time_ns;
      std::optional<Eigen::Vector3d> value;
    };
    std::vector<Event> events;
    for (const auto& m : measurements) events.push_back({m.time_ns, m.position_m});
    // Where the model begins.
    events.push_back({trajectory.origin_ns + std::llround(trajectory.knots_s[3] * 1e9), {}});
    for (int i = -20; i <= 190; ++i) events.push_back({Stamp(0.0837 * i), {}});
    std::stable_sort(events.begin(), events.end(),
                     [](const Event& a, const Event& b) { return a.time_ns < b.time_ns; });
    std::vector<double> times_s;
    std::vector<std::optional<Eigen::Vector3d>> values;
    for (const auto& event : events) {
      times_s.push_back(static_cast<double>(event.time_ns - kBeginNs) * 1e-9);
      values.push_back(event.value);
    }
    const auto acceleration = [&](double time_s) -> Eigen::Matrix3d {
      const double since_origin_s =
          time_s - static_cast<double>(trajectory.origin_ns - kBeginNs) * 1e-9;
      const int interval = IntervalAt(trajectory.knots_s, since_origin_s);
      return flight.acceleration * trajectory.agility[static_cast<std::size_t>(interval)];
    };
    const auto oracle =
        SmoothWithKalman(times_s, values, noise, acceleration, flight.acceleration, 2.0);
    for (std::size_t i = 0; i < events.size(); ++i) {
      if (events[i].value || times_s[i] < -2.0) continue;
      const TrajectoryRow row = trajectory.At(events[i].time_ns);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(row.position_m[axis], oracle[i].mean[axis], 0.1 * oracle[i].sigma[axis])
            << flight.speed << " m/s at " << times_s[i] << " s";
        EXPECT_NEAR(row.sigma_m[axis] / oracle[i].sigma[axis], 1.0, 0.08)
            << flight.speed << " m/s at " << times_s[i] << " s";
      }
    }
  }
}

TEST(Trajectory, ErrorsAreAsLargeAsSigmaSays) {
  struct Kind {
    std::string name;
    std::function<Path(Random&)> path;
    double duration_s, rate_hz, noise_m;
    double outlier_share = 0.0;  // moved by 2 to 20 m
  };
  const auto wander = [](double speed, double acceleration) {
    return [=](Random& random) { return Wander(speed, acceleration, random); };
  };
  const auto circle = [](Random&) { return Circle(20.0, 10.0); };
  const std::vector<Kind> kinds = {
      {"hover, 10 Hz", wander(0.05, 0.05), 20.0, 10.0, 0.1},
      {"hover, 1 Hz", wander(0.05, 0.05), 30.0, 1.0, 0.1},
      {"slow, 5 s", wander(0.2, 0.1), 5.0, 10.0, 0.05},
      {"5 m/s, 10 Hz", wander(5.0, 3.0), 20.0, 10.0, 0.1},
      {"5 m/s, 3 Hz", wander(5.0, 3.0), 20.0, 3.0, 0.2},
      {"20 m/s, 10 Hz", wander(20.0, 10.0), 20.0, 10.0, 0.1},
      {"20 m/s, 2 Hz", wander(20.0, 10.0), 20.0, 2.0, 0.1},
      {"20 m/s, 1 Hz", wander(20.0, 10.0), 30.0, 1.0, 0.2},
      {"5 m/s, 5 measurements", wander(5.0, 3.0), 5.0, 1.0, 0.1},
      {"hover, 5 measurements", wander(0.05, 0.05), 5.0, 1.0, 0.1},
      // In sparse data residuals say little of outliers, innovations all.
      {"10 m/s, 3 Hz, 10 % outliers", wander(10.0, 5.0), 20.0, 3.0, 0.1, 0.1},
      {"circle, 10 Hz", circle, 20.0, 10.0, 0.05},
      {"circle, 2 Hz", circle, 20.0, 2.0, 0.2},
  };
  for (const auto& kind : kinds) {
    Random random(6);
    double sum = 0.0;
    int count = 0;
    for (int flight = 0; flight < testing::Draws(60); ++flight) {
      const Path path = kind.path(random);
      auto measurements = Measure(path, kind.duration_s, kind.rate_hz, kind.noise_m, random);
      for (auto& m : measurements) {
        if (random.Uniform(0.0, 1.0) >= kind.outlier_share) continue;
        m.position_m += random.Uniform(2.0, 20.0) * random.Normal().normalized();
      }
      const Trajectory trajectory = FitTrajectory(measurements, {});
      const double end_s = static_cast<double>(trajectory.end_ns() - kBeginNs) * 1e-9;
      for (double t = static_cast<double>(trajectory.begin_ns() - kBeginNs) * 1e-9; t < end_s;
           t += 0.1) {
        const Eigen::Vector3d error_m = trajectory.At(Stamp(t)).position_m - path(t);
        sum += error_m.dot(trajectory.CovarianceAt(Stamp(t)).ldlt().solve(error_m));
        ++count;
      }
    }
    // Five measurements do not tell how even a flight is: their sigmas are a little wide.
    EXPECT_GT(sum / count, 1.8) << kind.name;
    EXPECT_LT(sum / count, 4.0) << kind.name;
  }
}

// Singer's model on one path, in steps of 10 ms: sigma_a at a time, tau after it.
constexpr double kStepS = 0.01;
struct Manner {
  std::function<double(double)> sigma_mps2;
  std::function<double(double)> tau_s;
};

std::vector<Eigen::Vector3d> Fly(const Manner& manner, double duration_s, Random& random) {
  std::vector<Eigen::Vector3d> path_m;
  Eigen::Vector3d x_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d v_mps = random.Normal();
  Eigen::Vector3d a_mps2 = manner.sigma_mps2(0.0) * random.Normal();
  for (double t = 0.0; t <= duration_s; t += kStepS) {
    path_m.push_back(x_m);
    const double share = kStepS / manner.tau_s(t);
    a_mps2 += -share * a_mps2 + manner.sigma_mps2(t) * std::sqrt(2.0 * share) * random.Normal();
    v_mps += kStepS * a_mps2;
    x_m += kStepS * v_mps;
  }
  return path_m;
}

Path PathOf(std::vector<Eigen::Vector3d> path_m) {
  return [path_m = std::move(path_m)](double t) {
    // Steps add up to a little more than their number: the last one may be missing.
    return path_m[std::min(static_cast<std::size_t>(std::lround(t / kStepS)), path_m.size() - 1)];
  };
}

TEST(Trajectory, AccelerationsLastAsLongAsTheFlightShows) {
  for (const double tau_s : {0.25, 1.0, 4.0}) {
    Random random(12);
    double sum = 0.0;
    const int num_flights = testing::Draws(30);
    for (int flight = 0; flight < num_flights; ++flight) {
      const Manner manner{[](double) { return 2.0; }, [&](double) { return tau_s; }};
      const Path path = PathOf(Fly(manner, 30.0, random));
      const Trajectory fitted = FitTrajectory(Measure(path, 30.0, 10.0, 0.05, random), {});
      sum += std::log2(fitted.scales.acceleration_time_s / tau_s);
    }
    EXPECT_NEAR(sum / num_flights, 0.0, 0.6) << tau_s;
  }
}

TEST(Trajectory, ADisabledPartOfTheModelOfMotionIsThatOfATypicalFlight) {
  Random random(5);
  const std::vector<Measurement> measurements =
      Measure(Wander(6.0, 3.0, random), 20.0, 20.0, 0.05, random);
  const auto fit = [&](const std::vector<MotionRule>& disabled_rules) {
    TrajectoryConfig config;
    config.disabled_rules = disabled_rules;
    return FitTrajectory(measurements, config);
  };
  const auto is_isotropic = [](const Eigen::Matrix3d& agility) {
    return agility.isApprox(agility(0, 0) * Eigen::Matrix3d::Identity(), 1e-12);
  };
  const auto is_one = [](const Eigen::Matrix3d& agility) { return agility.isIdentity(1e-12); };
  const auto all = [](const Trajectory& trajectory, const auto& holds) {
    return std::all_of(trajectory.agility.begin(), trajectory.agility.end(), holds);
  };
  const Trajectory whole = fit({});
  EXPECT_FALSE(all(whole, is_isotropic));
  EXPECT_NE(whole.scales.acceleration_time_s, kTypicalAccelerationTimeS);
  const Trajectory alike = fit({MotionRule::kDirection});
  EXPECT_TRUE(all(alike, is_isotropic));
  EXPECT_FALSE(all(alike, is_one));
  EXPECT_TRUE(all(fit({MotionRule::kAgility}), is_one));
  EXPECT_EQ(fit({MotionRule::kAccelerationTime}).scales.acceleration_time_s,
            kTypicalAccelerationTimeS);
}

TEST(Trajectory, AcrossAGapTheWayIsBetterKnownThanHowFarAlongItTheTargetIs) {
  for (const bool keeps_its_way : {true, false}) {
    Random random(13);
    double along_m = 0.0;
    double across_m = 0.0;
    double nees = 0.0;
    int count = 0;
    for (int flight = 0; flight < 40; ++flight) {
      const Manner manner{[](double) { return 1.0; }, [](double) { return 1.0; }};
      const Path wander = PathOf(Fly(manner, 30.0, random));
      const Eigen::Vector3d scale(2.0, keeps_its_way ? 0.2 : 2.0, keeps_its_way ? 0.2 : 2.0);
      const Path path = [&](double t) -> Eigen::Vector3d {
        return scale.cwiseProduct(wander(t)) + Eigen::Vector3d(8.0 * t, 0.0, 20.0);
      };
      auto measurements = Measure(path, 30.0, 5.0, 0.1, random);
      const auto is_in_gap = [](const Measurement& m) {
        return m.time_ns > Stamp(12.0) && m.time_ns < Stamp(15.0);
      };
      measurements.erase(std::remove_if(measurements.begin(), measurements.end(), is_in_gap),
                         measurements.end());
      const Trajectory trajectory = FitTrajectory(measurements, {});
      const TrajectoryRow row = trajectory.At(Stamp(13.5));
      along_m += row.sigma_m.x();
      across_m += row.sigma_m.y();
      for (double t = 12.5; t < 15.0; t += 0.5) {
        const Eigen::Vector3d error_m = trajectory.At(Stamp(t)).position_m - path(t);
        nees += error_m.dot(trajectory.CovarianceAt(Stamp(t)).ldlt().solve(error_m));
        ++count;
      }
    }
    if (keeps_its_way) {
      EXPECT_GT(along_m / across_m, 1.6);
    } else {
      EXPECT_NEAR(along_m / across_m, 1.0, 0.25);
    }
    EXPECT_GT(nees / count, 2.0) << keeps_its_way;
    EXPECT_LT(nees / count, 4.0) << keeps_its_way;
  }
}

// A flight that is calm but for a second in ten, in which it stops or goes: Singer's model with
// sigma_a 0.2 and 5 m/s^2.
bool IsBurst(double time_s) {
  return std::fmod(time_s, 10.0) >= 5.0 && std::fmod(time_s, 10.0) < 6.0;
}

Path StopAndGo(double duration_s, Random& random) {
  const auto sigma_mps2 = [](double t) { return IsBurst(t) ? 5.0 : 0.2; };
  // A manoeuvre ends.
  const auto tau_s = [](double t) { return IsBurst(t - 1.0) ? 0.1 : 2.0; };
  return PathOf(Fly({sigma_mps2, tau_s}, duration_s, random));
}

TEST(Trajectory, StopAndGoIsAsUncertainAsSigmaSaysInItsManoeuvresAndBetweenThem) {
  // In the manoeuvres one sigma_a for the whole flight has 10 and 16.
  struct Rate {
    double rate_hz, most_in_manoeuvres;
  };
  for (const auto& [rate_hz, most_in_manoeuvres] : {Rate{10.0, 5.0}, Rate{3.0, 9.0}}) {
    Random random(21);
    std::array<double, 2> sum{}, sigma_m{}, count{};  // between manoeuvres, in them
    for (int flight = 0; flight < testing::Draws(40); ++flight) {
      const Path at = StopAndGo(30.0, random);
      const Trajectory trajectory = FitTrajectory(Measure(at, 30.0, rate_hz, 0.1, random), {});
      for (double t = 1.0; t < 29.0; t += 0.1) {
        const Eigen::Vector3d error_m = trajectory.At(Stamp(t)).position_m - at(t);
        const Eigen::Matrix3d covariance_m2 = trajectory.CovarianceAt(Stamp(t));
        const auto part = static_cast<std::size_t>(IsBurst(t));
        sum[part] += error_m.dot(covariance_m2.ldlt().solve(error_m));
        sigma_m[part] += std::sqrt(covariance_m2.trace());
        count[part] += 1.0;
      }
    }
    EXPECT_GT(sum[0] / count[0], 2.0) << rate_hz;
    EXPECT_LT(sum[0] / count[0], 4.0) << rate_hz;
    EXPECT_GT(sum[1] / count[1], 2.0) << rate_hz;
    EXPECT_LT(sum[1] / count[1], most_in_manoeuvres) << rate_hz;
    EXPECT_GT(sigma_m[1] / count[1], 1.05 * sigma_m[0] / count[0]) << rate_hz;
  }
}

TEST(Trajectory, TheNoiseScaleIsFoundWhereCovariancesAreWrongByTwo) {
  Random random(8);
  auto measurements = Measure(Wander(5.0, 2.0, random), 20.0, 10.0, 0.1, random);
  for (const double stated : {0.5, 2.0}) {
    auto wrong = measurements;
    for (auto& m : wrong) m.covariance_m2 *= stated * stated;
    EXPECT_NEAR(FitTrajectory(wrong, {}).scales.noise * stated, 1.0, 0.15);
  }
}

TEST(Trajectory, CovariancesWeighTheAxesOfAMeasurement) {
  // Well known across the ray, badly along it, and the ray turns: the sigma of the fit must follow.
  Random random(9);
  auto measurements = Measure(Wander(0.05, 0.05, random), 10.0, 10.0, 0.05, random);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity() * 0.0025;
  covariance(0, 1) = covariance(1, 0) = 0.002;
  for (auto& m : measurements) m.covariance_m2 = covariance;
  const Eigen::Matrix3d fitted = FitTrajectory(measurements, {}).CovarianceAt(Stamp(5.0));
  // Motion is as likely one way as the other and evens them out: of noises whose variances differ
  // by 9, as here, there remain 9^(3/4) to 9^(5/6), as accelerations last for short or long.
  EXPECT_GT(fitted(0, 1) / fitted(0, 0), 0.67);
  EXPECT_LT(fitted(0, 1) / fitted(0, 0), 0.74);
  EXPECT_NEAR(fitted(0, 2) / fitted(0, 0), 0.0, 1e-6);
}

TEST(Trajectory, AFewMeasurementsGiveALineWithLargeSigma) {
  const Path line = Line();
  const Trajectory one = FitTrajectory({At(0.0, line(0.0), 0.1)}, {});
  ExpectFinite(one);
  EXPECT_LT((one.At(Stamp(0.0)).position_m - line(0.0)).norm(), 1e-6);
  EXPECT_NEAR(one.At(Stamp(0.0)).sigma_m.x(), 0.1, 0.03);
  EXPECT_GT(one.At(Stamp(1.0)).sigma_m.x(), 10.0);

  const Trajectory two = FitTrajectory({At(0.0, line(0.0), 0.1), At(1.0, line(1.0), 0.1)}, {});
  ExpectFinite(two);
  EXPECT_LT((two.At(Stamp(0.5)).position_m - line(0.5)).norm(), 0.05);
  EXPECT_GT(two.At(Stamp(3.0)).sigma_m.x(), 0.5);

  std::vector<Measurement> four;
  for (const double t : {0.0, 0.9, 2.1, 2.9}) four.push_back(At(t, line(t), 0.1));
  const Trajectory fitted = FitTrajectory(four, {});
  ExpectFinite(fitted);
  EXPECT_LT((fitted.At(Stamp(1.5)).position_m - line(1.5)).norm(), 0.05);
}

TEST(Trajectory, ManyMeasurementsAtOneTimeAreTheirMean) {
  Random random(10);
  std::vector<Measurement> measurements;
  Eigen::Vector3d mean_m = Eigen::Vector3d::Zero();
  for (int i = 0; i < 50; ++i) {
    measurements.push_back(At(1.0, Eigen::Vector3d(1, 2, 3) + 0.1 * random.Normal(), 0.1));
    mean_m += measurements.back().position_m / 50.0;
  }
  const Trajectory trajectory = FitTrajectory(measurements, {});
  ExpectFinite(trajectory);
  EXPECT_LT((trajectory.At(Stamp(1.0)).position_m - mean_m).norm(), 0.005);
  EXPECT_NEAR(trajectory.At(Stamp(1.0)).sigma_m.x(), 0.1 / std::sqrt(50.0), 0.003);
}

TEST(Trajectory, ManyMeasurementsAndAbsurdGapsStayFinite) {
  Random random(11);
  const auto many = Measure(Wander(10.0, 5.0, random), 30.0, 5000.0 / 30.0, 0.1, random);
  const Trajectory dense = FitTrajectory(many, {});
  ExpectFinite(dense);
  EXPECT_EQ(dense.weights.size(), 5000u);
  const double year_s = 3.2e7;
  ExpectFinite(FitTrajectory(
      {At(0.0, {0, 0, 5}, 0.1), At(0.1, {0, 0, 5}, 0.1), At(year_s, {1e6, 0, 5}, 0.1)}, {}));
}

TEST(Trajectory, AnyMeasurementsGiveFiniteNumbers) {
  // Positions that are no flight at all, repeated times, sigmas that differ by orders of magnitude.
  Random random(16);
  const auto magnitude = [&](double low, double high) {
    return std::pow(10.0, random.Uniform(low, high));
  };
  for (int run = 0; run < testing::Draws(200); ++run) {
    const double span_s = magnitude(-2.0, 2.5);
    const double sigma_m = magnitude(-3.0, 1.0);
    const double size_m = magnitude(-3.0, 3.0);
    std::vector<double> times_s(static_cast<std::size_t>(magnitude(0.0, 2.0)));
    for (double& time_s : times_s) time_s = std::max(0.0, random.Uniform(-0.3, 1.0)) * span_s;
    std::sort(times_s.begin(), times_s.end());
    std::vector<Measurement> measurements;
    for (const double time_s : times_s) {
      measurements.push_back(At(time_s, size_m * random.Normal(), sigma_m));
      measurements.back().covariance_m2(0, 0) *= magnitude(-2.0, 2.0);
    }
    SCOPED_TRACE(run);
    ExpectFinite(FitTrajectory(measurements, {}));
  }
}

TEST(Trajectory, ItDoesNotDependOnTheEpochOrTheOrigin) {
  Random random(12);
  const auto measurements = Measure(Wander(5.0, 2.0, random), 20.0, 10.0, 0.1, random);
  auto moved = measurements;
  const Eigen::Vector3d far_m(5e5, 4e6, 100.0);
  for (auto& m : moved) {
    m.time_ns -= kBeginNs;
    m.position_m += far_m;
  }
  const Trajectory here = FitTrajectory(measurements, {});
  const Trajectory there = FitTrajectory(moved, {});
  for (double t = 0.0; t < 20.0; t += 0.1) {
    const TrajectoryRow a = here.At(Stamp(t));
    const TrajectoryRow b = there.At(Stamp(t) - kBeginNs);
    EXPECT_LT((a.position_m + far_m - b.position_m).norm(), 1e-6);
    EXPECT_LT((a.sigma_m - b.sigma_m).norm(), 1e-6);
  }
}

TEST(Trajectory, TheSameMeasurementsGiveTheSameDigits) {
  Random random(13);
  const auto measurements = Measure(Wander(5.0, 2.0, random), 20.0, 10.0, 0.1, random);
  const Trajectory a = FitTrajectory(measurements, {});
  const Trajectory b = FitTrajectory(measurements, {});
  EXPECT_EQ(a.control_points_m, b.control_points_m);
  EXPECT_EQ(a.weights, b.weights);
}

TEST(Trajectory, WhatAFitterFittedBeforeChangesNothing) {
  Random random(18);
  TrajectoryFitter fitter{TrajectoryConfig()};
  Trajectory trajectory;
  for (const double duration_s : {20.0, 3.0, 30.0, 0.5}) {
    const auto measurements = Measure(Wander(5.0, 2.0, random), duration_s, 10.0, 0.1, random);
    const Trajectory expected = FitTrajectory(measurements, {});
    fitter.Fit(measurements, trajectory);
    for (const bool is_refit : {false, true}) {
      if (is_refit) fitter.Refit(measurements, expected.scales, trajectory);
      const Trajectory anew =
          is_refit ? RefitTrajectory(measurements, expected.scales, {}) : expected;
      EXPECT_EQ(trajectory.knots_s, anew.knots_s);
      EXPECT_EQ(trajectory.agility, anew.agility);
      EXPECT_EQ(trajectory.weights, anew.weights);
      EXPECT_EQ(trajectory.control_points_m, anew.control_points_m);
      EXPECT_EQ(trajectory.covariance_m2, anew.covariance_m2);
      EXPECT_EQ(trajectory.minimum.iterations, anew.minimum.iterations);
    }
  }
}

TEST(Trajectory, ARefitAtTheFoundScalesIsTheFit) {
  Random random(14);
  const auto measurements = Measure(Wander(5.0, 2.0, random), 20.0, 10.0, 0.1, random);
  const Trajectory fitted = FitTrajectory(measurements, {});
  const Trajectory again = RefitTrajectory(measurements, fitted.scales, {});
  EXPECT_LT(LargestShift(fitted, again, 20.0), 1e-6);
}

TEST(Trajectory, VelocityIsTheDerivativeOfPosition) {
  Random random(15);
  const Trajectory trajectory =
      FitTrajectory(Measure(Wander(10.0, 5.0, random), 10.0, 10.0, 0.1, random), {});
  for (double t = 0.5; t < 9.5; t += 0.1) {
    const Eigen::Vector3d numeric_mps =
        (trajectory.At(Stamp(t + 0.001)).position_m - trajectory.At(Stamp(t - 0.001)).position_m) /
        0.002;
    EXPECT_LT((numeric_mps - trajectory.At(Stamp(t)).velocity_mps).norm(), 1e-3);
  }
}

TEST(Trajectory, WhatIsNoMeasurementIsRefused) {
  const Measurement good = At(0.0, {1, 2, 3}, 0.1);
  const Measurement later = At(1.0, {1, 2, 3}, 0.1);
  Measurement infinite = good;
  infinite.position_m.x() = std::numeric_limits<double>::infinity();
  Measurement flat = good;
  flat.covariance_m2(2, 2) = 0.0;
  EXPECT_THROW(FitTrajectory({}, {}), std::invalid_argument);
  EXPECT_THROW(FitTrajectory({later, good}, {}), std::invalid_argument);
  EXPECT_THROW(FitTrajectory({infinite}, {}), std::invalid_argument);
  EXPECT_THROW(FitTrajectory({flat}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace unlidar
