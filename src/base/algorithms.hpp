// Algorithms that the standard library of C++17 lacks.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

namespace unlidar {

// Same as std::erase_if() of C++20: erases the values for which the predicate holds.
template <class Values, class Predicate>
void EraseIf(Values* values, const Predicate& predicate) {
  values->erase(std::remove_if(values->begin(), values->end(), predicate), values->end());
}

// Erases the first `count` values.
template <class T>
void DropFirst(std::size_t count, std::vector<T>* values) {
  values->erase(values->begin(), values->begin() + static_cast<std::ptrdiff_t>(count));
}

// Returns the value whose bytes begin at `from`, aligned or not. What is read is little endian, as
// this computer is.
template <class Value>
Value LoadAs(const void* from) {
  static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
  Value value;
  std::memcpy(&value, from, sizeof(value));
  return value;
}

// Returns the numbers below `count`.
inline std::vector<std::uint32_t> NumbersBelow(std::size_t count) {
  std::vector<std::uint32_t> numbers(count);
  std::iota(numbers.begin(), numbers.end(), 0U);
  return numbers;
}

// Returns the values with these numbers.
template <class T>
std::vector<T> ValuesAt(const std::vector<std::uint32_t>& numbers, const std::vector<T>& values) {
  std::vector<T> chosen;
  chosen.reserve(numbers.size());
  for (const std::uint32_t i : numbers) chosen.push_back(values[i]);
  return chosen;
}

// Returns the values in ascending order, without duplicates.
template <class T>
std::vector<T> SortedUnique(std::vector<T> values) {
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  return values;
}

// Counting sort of items by group, which keeps their order within each: calls place(item, position)
// for every item. `group_of` (items). Sets `begins` (groups + 1): group g has the positions from
// begins[g] to begins[g + 1].
template <class Place>
void SortByGroup(const std::vector<std::uint32_t>& group_of, std::size_t num_groups,
                 std::vector<std::uint32_t>* begins, const Place& place) {
  begins->assign(num_groups + 2, 0);
  for (const std::uint32_t group : group_of) ++(*begins)[group + 2];
  std::partial_sum(begins->begin(), begins->end(), begins->begin());
  // (*begins)[g + 1] moves from the begin of group g to its end.
  for (std::size_t i = 0; i < group_of.size(); ++i) place(i, (*begins)[group_of[i] + 1]++);
  begins->pop_back();
}

// Returns the value that sorting would put at `begin` + n. Reorders the values.
template <class Iterator>
auto NthSmallest(Iterator begin, Iterator end, std::ptrdiff_t n) {
  std::nth_element(begin, begin + n, end);
  return begin[n];
}

// Returns the median step between consecutive values, of at least two; the lower one of an even
// number of steps. `steps`: buffer.
template <class Number>
Number MedianStep(const std::vector<Number>& values, std::vector<Number>* steps) {
  steps->clear();
  for (std::size_t i = 1; i < values.size(); ++i) steps->push_back(values[i] - values[i - 1]);
  const auto size = static_cast<std::ptrdiff_t>(steps->size());
  return NthSmallest(steps->begin(), steps->end(), (size - 1) / 2);
}

}  // namespace unlidar
