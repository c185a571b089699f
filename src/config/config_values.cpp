#include "config/config_values.hpp"

#include <limits>
#include <optional>

namespace unlidar {
namespace {

constexpr double kUnitNormTolerance = 1e-3;

template <class Number>
bool ParseScalar(const YAML::Node& node, Number& value) {
  const auto number = node.IsScalar() ? ParseNumber<Number>(node.Scalar()) : std::nullopt;
  value = number.value_or(value);
  return number.has_value();
}

// A normalized quaternion has a norm that is off by at most 1.5 epsilon.
constexpr double kRoundedNormTolerance = 4 * std::numeric_limits<double>::epsilon();

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
         NumberText(range.high) +
         (range.may_be_endless ? std::string(", or ") + kInfinityText : "");
}

std::string Expected(const bool&, Flag) { return "true or false"; }

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

bool Holds(bool, Flag) { return true; }

bool Holds(double field, const Range& constraint) {
  const bool is_endless = field == std::numeric_limits<double>::infinity();
  if (is_endless && constraint.may_be_endless) return true;
  return field >= constraint.low && field <= constraint.high &&
         (constraint.low_is_allowed || field != constraint.low);
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

bool Parse(const YAML::Node& node, bool& value) {
  if (!node.IsScalar()) return false;
  value = node.Scalar() == "true";
  return value || node.Scalar() == "false";
}

bool Parse(const YAML::Node& node, int& value) { return ParseScalar(node, value); }

bool Parse(const YAML::Node& node, double& value) {
  if (ParseScalar(node, value)) return std::isfinite(value);
  value = std::numeric_limits<double>::infinity();
  return node.IsScalar() && node.Scalar() == kInfinityText;
}

bool Parse(const YAML::Node& node, Eigen::Ref<Eigen::VectorXd> value) {
  if (!node.IsSequence() || node.size() != static_cast<std::size_t>(value.size())) return false;
  for (std::size_t i = 0; i < node.size(); ++i) {
    if (!Parse(node[i], value[static_cast<Eigen::Index>(i)])) return false;
  }
  return true;
}

void NormalizeOnce(Eigen::Vector4d& quaternion) {
  if (std::abs(quaternion.norm() - 1.0) > kRoundedNormTolerance) quaternion.normalize();
}

}  // namespace unlidar
