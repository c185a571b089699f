// Config values under their constraints: reading from YAML, listing as JSON, describing in
// messages.
#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
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

// Returns the value as the user wrote it, for messages.
std::string Quote(const YAML::Node& node);

// Formats a number; whole numbers have no exponent.
std::string NumberText(double value);

// Describes the constraint of a key, to follow "expected" in a message.
std::string Expected(const bool& field, Flag constraint);
std::string Expected(const std::vector<double>& field, const Elements& constraint);
std::string Expected(const Eigen::Vector3d& field, const Vector3& constraint);
std::string Expected(const Eigen::Vector4d& field, UnitQuaternion constraint);

// Returns " from 0 to 10", or " above 0 to 10, or .inf".
std::string Interval(const Range& range);

template <class Number>
std::string Expected(const Number&, const Range& range) {
  return (std::is_integral_v<Number> ? "an integer" : "a number") + Interval(range);
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

template <class E>
std::string Expected(const E&, const Choices<E>& choices) {
  return "one of " + NamesOf(choices);
}

template <class E>
std::string Expected(const std::vector<E>&, const Subset<E>& constraint) {
  return "a list of different ones, of " + NamesOf(constraint.each);
}

// True if a value satisfies its constraint.
bool Holds(bool field, Flag constraint);
bool Holds(double field, const Range& constraint);  // integers, too
bool Holds(const std::vector<double>& field, const Elements& constraint);
bool Holds(const Eigen::Vector3d& field, const Vector3& constraint);
bool Holds(const Eigen::Vector4d& field, UnitQuaternion constraint);

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

// Sets a value if the node has one of its type, whatever the constraint says about it.
bool Parse(const YAML::Node& node, bool& value);
bool Parse(const YAML::Node& node, int& value);
bool Parse(const YAML::Node& node, double& value);  // finite, or kInfinityText
bool Parse(const YAML::Node& node, Eigen::Ref<Eigen::VectorXd> value);

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

// Normalizes a quaternion unless it is normalized but for rounding: to divide by a norm of 1 +
// 1e-16 again would change what is listed of a configuration each time that it is read.
void NormalizeOnce(Eigen::Vector4d& quaternion);

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
