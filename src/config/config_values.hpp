// Config values under their constraints: reading from YAML, listing as JSON, describing in
// messages.
#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/format.hpp"
#include "config/config_keys.hpp"

namespace unlidar {

inline constexpr const char* kInfinityText = ".inf";
inline constexpr double kUnitNormTolerance = 1e-3;

// Returns the value as the user wrote it, for messages.
inline std::string Quote(const YAML::Node& node) {
  if (!node.IsDefined() || node.IsNull()) return "nothing";
  if (node.IsScalar()) return Quoted(node.Scalar());
  YAML::Emitter emitter;
  emitter.SetSeqFormat(YAML::Flow);
  emitter.SetMapFormat(YAML::Flow);
  emitter << node;
  return Quoted(emitter.c_str());
}

// Formats a number; whole numbers have no exponent.
inline std::string NumberText(double value) {
  return std::abs(value) < 1e15 && value == std::floor(value) ? FixedText(value, 0)
                                                              : ShortestText(value);
}

// Returns " from 0 to 10", or " above 0 to 10, or .inf".
inline std::string Interval(const Range& range) {
  return (range.low_is_allowed ? " from " : " above ") + NumberText(range.low) + " to " +
         NumberText(range.high) +
         (range.may_be_endless ? std::string(", or ") + kInfinityText : "");
}

// Returns all names: "robust, paper".
template <class E>
std::string NamesOf(const Choices<E>& choices) {
  std::string text;
  for (const auto& choice : choices.names) {
    text += std::string(text.empty() ? "" : ", ") + choice.first;
  }
  return text;
}

// Describes the constraint of a key, to follow "expected" in a message.
inline std::string Expected(const bool&, Flag) { return "true or false"; }

template <class Number>
std::string Expected(const Number&, const Range& range) {
  return (std::is_integral_v<Number> ? "an integer" : "a number") + Interval(range);
}

inline std::string Expected(const std::vector<double>&, const Elements& constraint) {
  return "a list of one or more numbers, each" + Interval(constraint.each);
}

inline std::string Expected(const Eigen::Vector3d&, const Vector3& constraint) {
  return "a list of 3 numbers [x, y, z], each at most " + NumberText(constraint.max_abs) +
         " in size";
}

inline std::string Expected(const Eigen::Vector4d&, UnitQuaternion) {
  return "a quaternion [x, y, z, w] of norm 1 (within " + ShortestText(kUnitNormTolerance) + ")";
}

template <class E>
std::string Expected(const E&, const Choices<E>& choices) {
  return "one of " + NamesOf(choices);
}

template <class E>
std::string Expected(const std::vector<E>&, const Subset<E>& constraint) {
  return "a list of different ones, of " + NamesOf(constraint.each);
}

// True if a value satisfies its constraint.
inline bool Holds(bool, Flag) { return true; }

inline bool Holds(double field, const Range& constraint) {  // integers, too
  const bool is_endless = field == std::numeric_limits<double>::infinity();
  if (is_endless && constraint.may_be_endless) return true;
  return field >= constraint.low && field <= constraint.high &&
         (constraint.low_is_allowed || field != constraint.low);
}

inline bool Holds(const std::vector<double>& field, const Elements& constraint) {
  return !field.empty() && std::all_of(field.begin(), field.end(),
                                       [&](double value) { return Holds(value, constraint.each); });
}

inline bool Holds(const Eigen::Vector3d& field, const Vector3& constraint) {
  return field.allFinite() && field.cwiseAbs().maxCoeff() <= constraint.max_abs;
}

inline bool Holds(const Eigen::Vector4d& field, UnitQuaternion) {
  return std::abs(field.norm() - 1.0) <= kUnitNormTolerance;
}

template <class E>
bool Holds(const E& field, const Choices<E>& choices) {
  return std::any_of(choices.names.begin(), choices.names.end(),
                     [&](const auto& choice) { return choice.second == field; });
}

template <class E>
bool Holds(const std::vector<E>& field, const Subset<E>& constraint) {
  return std::set<E>(field.begin(), field.end()).size() == field.size() &&
         std::all_of(field.begin(), field.end(),
                     [&](const E& value) { return Holds(value, constraint.each); });
}

// Formats a value that was set in code, for messages.
template <class Field>
std::string TextOf(const Field& field) {
  if constexpr (std::is_enum_v<Field>) {
    return "number " + std::to_string(static_cast<int>(field));
  } else if constexpr (std::is_arithmetic_v<Field>) {
    return NumberText(static_cast<double>(field));
  } else {
    std::string text = "[";
    for (const auto value : field) {
      text += (text == "[" ? "" : ", ") + NumberText(static_cast<double>(value));
    }
    return text + "]";
  }
}

template <class Number>
bool ParseScalar(const YAML::Node& node, Number& value) {
  const auto number = node.IsScalar() ? ParseNumber<Number>(node.Scalar()) : std::nullopt;
  value = number.value_or(value);
  return number.has_value();
}

// Sets a value if the node has one of its type, whatever the constraint says about it.
inline bool Parse(const YAML::Node& node, bool& value) {
  if (!node.IsScalar()) return false;
  value = node.Scalar() == "true";
  return value || node.Scalar() == "false";
}

inline bool Parse(const YAML::Node& node, int& value) { return ParseScalar(node, value); }

inline bool Parse(const YAML::Node& node, double& value) {  // finite, or kInfinityText
  if (ParseScalar(node, value)) return std::isfinite(value);
  value = std::numeric_limits<double>::infinity();
  return node.IsScalar() && node.Scalar() == kInfinityText;
}

inline bool Parse(const YAML::Node& node, Eigen::Ref<Eigen::VectorXd> value) {
  if (!node.IsSequence() || node.size() != static_cast<std::size_t>(value.size())) return false;
  for (std::size_t i = 0; i < node.size(); ++i) {
    if (!Parse(node[i], value[static_cast<Eigen::Index>(i)])) return false;
  }
  return true;
}

template <class Value, class Constraint>
bool Parse(const YAML::Node& node, Value& value, const Constraint& constraint) {
  if constexpr (std::is_enum_v<Value>) {
    for (const auto& [name, choice] : constraint.names) {
      if (!node.IsScalar() || node.Scalar() != name) continue;
      value = choice;
      return true;
    }
    return false;
  } else {
    return Parse(node, value);
  }
}

template <class Value, class Constraint>
bool Parse(const YAML::Node& node, std::vector<Value>& values, const Constraint& constraint) {
  if (!node.IsSequence()) return false;
  values.resize(node.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!Parse(node[i], values[i], constraint.each)) return false;
  }
  return true;
}

// Normalizes a quaternion unless it is normalized but for rounding, then off by at most 1.5
// epsilon: to divide by a norm of 1 + 1e-16 again would change what is listed of a configuration
// each time that it is read.
inline void NormalizeOnce(Eigen::Vector4d& quaternion) {
  constexpr double kRoundedNormTolerance = 4 * std::numeric_limits<double>::epsilon();
  if (std::abs(quaternion.norm() - 1.0) > kRoundedNormTolerance) quaternion.normalize();
}

// Sets the field and returns true if the node satisfies the constraint.
template <class Field, class Constraint>
bool Read(const YAML::Node& node, Field& field, const Constraint& constraint) {
  Field value = field;
  if (!Parse(node, value, constraint) || !Holds(value, constraint)) return false;
  if constexpr (std::is_same_v<Constraint, UnitQuaternion>) NormalizeOnce(value);
  field = std::move(value);
  return true;
}

// Returns the value of a field for ConfigJson(). Infinity becomes text: JSON has no number for it.
template <class Value, class Constraint>
nlohmann::ordered_json JsonOf(const Value& value, const Constraint& constraint) {
  if constexpr (std::is_enum_v<Value>) {
    for (const auto& [name, choice] : constraint.names) {
      if (choice == value) return name;
    }
    throw std::logic_error("a config field holds a value without a name");
  } else if constexpr (std::is_arithmetic_v<Value>) {
    if (std::isinf(static_cast<double>(value))) return kInfinityText;
    return value;
  } else {
    return std::vector<double>(value.begin(), value.end());
  }
}

template <class E>
nlohmann::ordered_json JsonOf(const std::vector<E>& values, const Subset<E>& constraint) {
  auto names = nlohmann::ordered_json::array();
  for (const E value : values) names.push_back(JsonOf(value, constraint.each));
  return names;
}

}  // namespace unlidar
