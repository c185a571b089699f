// FIFO queue in contiguous memory.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace unlidar {

// Queue in one memory block that is reused: std::deque keeps allocating and freeing as values pass
// through. Removed values stay in place, with their own memory, for reuse by Append().
template <class T>
class Queue {
 public:
  using Iterator = typename std::vector<T>::iterator;
  using ConstIterator = typename std::vector<T>::const_iterator;

  bool empty() const { return first_ == last_; }
  std::size_t size() const { return last_ - first_; }

  Iterator begin() { return values_.begin() + static_cast<std::ptrdiff_t>(first_); }
  Iterator end() { return values_.begin() + static_cast<std::ptrdiff_t>(last_); }
  ConstIterator begin() const { return values_.begin() + static_cast<std::ptrdiff_t>(first_); }
  ConstIterator end() const { return values_.begin() + static_cast<std::ptrdiff_t>(last_); }

  T& front() { return values_[first_]; }
  const T& front() const { return values_[first_]; }
  T& back() { return values_[last_ - 1]; }
  const T& operator[](std::size_t i) const { return values_[first_ + i]; }

  // Appends a value and returns it in the state in which it was removed. May move the others.
  T& Append() {
    if (last_ == values_.size()) MakeRoom();
    return values_[last_++];
  }

  void push_back(T value) { Append() = std::move(value); }

  // Inserts before `at`.
  void Insert(ConstIterator at, T value) {
    const std::ptrdiff_t index = at - std::as_const(*this).begin();
    push_back(std::move(value));
    std::rotate(begin() + index, end() - 1, end());
  }

  void pop_front() {
    if (++first_ == last_) clear();
  }

  void clear() { first_ = last_ = 0; }

  // Frees unused memory.
  void ShrinkToFit() {
    values_.erase(end(), values_.end());
    values_.erase(values_.begin(), begin());
    values_.shrink_to_fit();
    first_ = 0;
    last_ = values_.size();
  }

 private:
  // Moves the values to the front only if at least half of the block is free there, so that there
  // are no more moves than removals.
  void MakeRoom() {
    if (first_ == 0 || 2 * first_ < values_.size()) {
      values_.emplace_back();
      return;
    }
    std::rotate(values_.begin(), begin(), values_.end());
    last_ -= first_;
    first_ = 0;
  }

  std::vector<T> values_;
  std::size_t first_ = 0;  // [first_, last_) are the queued values
  std::size_t last_ = 0;
};

}  // namespace unlidar
