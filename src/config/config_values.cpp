#include "config/config_values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/format.hpp"

namespace unlidar {
namespace {

constexpr double kUnitNormTolerance = 1e-3;

template <int kSize>
bool ReadNumbers(const YAML::Node& node, Eigen::Matrix<double, kSize, 1>& field) {
  if (!node.IsSequence() || node.size() != kSize) return false;
  for (int i = 0; i < kSize; ++i) {
    const auto value = ParseNumber<double>(node[i]);
    if (!value) return false;
    field[i] = *value;
  }
  return true;
}

}  // namespace

std::string Quote(const YAML::Node& node) {
  if (!node.IsDefined() || node.IsNull()) return "nothing";
  if (node.IsScalar()) return Quoted(node.Scalar());
  YAML::Emitter emitter;
  emitter.SetSeqFormat(YAML::Flow);
  emitter.SetMapFormat(YAML::Flow);
  emitter << node;
  return Quoted(emitter.c_str());
}

std::string NumberText(double value) {
  return std::abs(value) < 1e15 && value == std::floor(value) ? FixedText(value, 0)
                                                              : ShortestText(value);
}

std::string Interval(const Range& range) {
  return (range.low_is_allowed ? " from " : " above ") + NumberText(range.low) + " to " +
         NumberText(range.high);
}

std::string Expected(const bool&, Flag) { return "true or false"; }

std::string Expected(const double& field, const RangeOrEndless& constraint) {
  return Expected(field, constraint.finite) + ", or " + kInfinityText;
}

std::string Expected(const std::vector<double>&, const Elements& constraint) {
  return "a list of one or more numbers, each" + Interval(constraint.each);
}

std::string Expected(const Eigen::Vector3d&, const Vector3& constraint) {
  return "a list of 3 numbers [x, y, z], each at most " + NumberText(constraint.max_abs) +
         " in size";
}

std::string Expected(const Eigen::Vector4d&, UnitQuaternion) {
  return "a quaternion [x, y, z, w] of norm 1 (within " + ShortestText(kUnitNormTolerance) + ")";
}

bool Holds(const std::vector<double>& field, const Elements& constraint) {
  return !field.empty() && std::all_of(field.begin(), field.end(),
                                       [&](double value) { return Holds(value, constraint.each); });
}

bool Holds(const Eigen::Vector3d& field, const Vector3& constraint) {
  return field.allFinite() && field.cwiseAbs().maxCoeff() <= constraint.max_abs;
}

bool Holds(const Eigen::Vector4d& field, UnitQuaternion) {
  return std::abs(field.norm() - 1.0) <= kUnitNormTolerance;
}

bool Read(const YAML::Node& node, bool& field, Flag) {
  if (!node.IsScalar() || (node.Scalar() != "true" && node.Scalar() != "false")) return false;
  field = node.Scalar() == "true";
  return true;
}

bool Read(const YAML::Node& node, double& field, const RangeOrEndless& constraint) {
  if (!node.IsScalar() || node.Scalar() != kInfinityText) {
    return Read(node, field, constraint.finite);
  }
  field = std::numeric_limits<double>::infinity();
  return true;
}

bool Read(const YAML::Node& node, std::vector<double>& field, const Elements& constraint) {
  if (!node.IsSequence() || node.size() == 0) return false;
  std::vector<double> values(node.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!Read(node[i], values[i], constraint.each)) return false;
  }
  field = std::move(values);
  return true;
}

bool Read(const YAML::Node& node, Eigen::Vector3d& field, const Vector3& constraint) {
  return ReadNumbers(node, field) && Holds(field, constraint);
}

bool Read(const YAML::Node& node, Eigen::Vector4d& field, UnitQuaternion constraint) {
  if (!ReadNumbers(node, field) || !Holds(field, constraint)) return false;
  field.normalize();
  return true;
}

}  // namespace unlidar
