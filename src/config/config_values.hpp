// Config values under their constraints: reading from YAML, listing, describing in messages.
#pragma once

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "config/config.hpp"
#include "config/config_keys.hpp"

namespace unlidar {

inline constexpr const char* kInfinityText = ".inf";

// Returns the value as the user wrote it, for messages.
std::string Quote(const YAML::Node& node);

// Formats a number; whole numbers have no exponent.
std::string NumberText(double value);

// Returns " from 0 to 10" or " above 0 to 10".
std::string Interval(const Range& range);

// Describes the constraint of a key, to follow "expected" in a message.
std::string Expected(const bool& field, Flag constraint);
std::string Expected(const double& field, const RangeOrEndless& constraint);
std::string Expected(const std::vector<double>& field, const Elements& constraint);
std::string Expected(const Eigen::Vector3d& field, const Vector3& constraint);
std::string Expected(const Eigen::Vector4d& field, UnitQuaternion constraint);

template <class Number>
std::string Expected(const Number&, const Range& range) {
  return (std::is_integral_v<Number> ? "an integer" : "a number") + Interval(range);
}

// Returns all names: "robust, paper".
template <class E>
std::string NamesOf(const Choices<E>& choices) {
  std::string text;
  for (const auto& [name, value] : choices.names) {
    if (!text.empty()) text += ", ";
    text += name;
  }
  return text;
}

template <class E>
std::string Expected(const E&, const Choices<E>& choices) {
  return "one of " + NamesOf(choices);
}

template <class E>
std::string Expected(const std::vector<E>&, const Subset<E>& constraint) {
  return "a list of different ones, of " + NamesOf(constraint.of);
}

// Parses the whole text as a decimal number, in any locale; empty if it is not one.
template <class Number>
std::optional<Number> ParseNumber(const YAML::Node& node) {
  if (!node.IsScalar()) return std::nullopt;
  const std::string& text = node.Scalar();
  const char* end = text.data() + text.size();
  Number value{};
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

// True if a value satisfies its constraint.
inline bool Holds(bool, Flag) { return true; }
bool Holds(const std::vector<double>& field, const Elements& constraint);
bool Holds(const Eigen::Vector3d& field, const Vector3& constraint);
bool Holds(const Eigen::Vector4d& field, UnitQuaternion constraint);

template <class Number>
bool Holds(const Number& field, const Range& range) {
  const auto number = static_cast<double>(field);
  return number >= range.low && number <= range.high &&
         (range.low_is_allowed || number != range.low);
}

inline bool Holds(const double& field, const RangeOrEndless& constraint) {
  return field == std::numeric_limits<double>::infinity() || Holds(field, constraint.finite);
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
                     [&](const E& value) { return Holds(value, constraint.of); });
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

// Sets the field and returns true if the node satisfies the constraint.
bool Read(const YAML::Node& node, bool& field, Flag constraint);
bool Read(const YAML::Node& node, double& field, const RangeOrEndless& constraint);
bool Read(const YAML::Node& node, std::vector<double>& field, const Elements& constraint);
bool Read(const YAML::Node& node, Eigen::Vector3d& field, const Vector3& constraint);
bool Read(const YAML::Node& node, Eigen::Vector4d& field, UnitQuaternion constraint);

template <class Number>
bool Read(const YAML::Node& node, Number& field, const Range& range) {
  const auto value = ParseNumber<Number>(node);
  if (!value || !Holds(*value, range)) return false;
  field = *value;
  return true;
}

template <class E>
bool Read(const YAML::Node& node, E& field, const Choices<E>& choices) {
  if (!node.IsScalar()) return false;
  for (const auto& [name, value] : choices.names) {
    if (node.Scalar() != name) continue;
    field = value;
    return true;
  }
  return false;
}

template <class E>
bool Read(const YAML::Node& node, std::vector<E>& field, const Subset<E>& constraint) {
  if (!node.IsSequence()) return false;
  std::vector<E> values(node.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!Read(node[i], values[i], constraint.of)) return false;
  }
  if (!Holds(values, constraint)) return false;
  field = std::move(values);
  return true;
}

// Returns the value of a field for ListConfig().
inline ConfigValue ValueOf(bool field, Flag) { return field; }
inline ConfigValue ValueOf(const std::vector<double>& field, const Elements&) { return field; }
// Infinity becomes text: JSON has no number for it.
inline ConfigValue ValueOf(double field, const RangeOrEndless&) {
  return std::isfinite(field) ? ConfigValue(field) : ConfigValue(std::string(kInfinityText));
}
inline ConfigValue ValueOf(const Eigen::Vector3d& field, const Vector3&) {
  return std::vector<double>(field.begin(), field.end());
}
inline ConfigValue ValueOf(const Eigen::Vector4d& field, UnitQuaternion) {
  return std::vector<double>(field.begin(), field.end());
}

template <class Number>
ConfigValue ValueOf(Number field, const Range&) {
  if constexpr (std::is_integral_v<Number>) return static_cast<std::int64_t>(field);
  return static_cast<double>(field);
}

template <class E>
ConfigValue ValueOf(E field, const Choices<E>& choices) {
  for (const auto& [name, value] : choices.names) {
    if (value == field) return std::string(name);
  }
  throw std::logic_error("a config field holds a value without a name");
}

template <class E>
ConfigValue ValueOf(const std::vector<E>& field, const Subset<E>& constraint) {
  std::vector<std::string> names;
  names.reserve(field.size());
  for (const E value : field) {
    names.push_back(std::get<std::string>(ValueOf(value, constraint.of)));
  }
  return names;
}

}  // namespace unlidar
