// FIFO queue in blocks of memory.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace unlidar {

// For long queues and tables: it grows without a copy and without room for as many values again.
// Blocks are reused, so that a queue that loses as much as it gains allocates nothing.
template <class T>
class BlockQueue {
 public:
  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }
  const T& front() const { return (*this)[0]; }
  const T& operator[](std::size_t i) const {
    return blocks_[(first_ + i) / kBlockSize][(first_ + i) % kBlockSize];
  }
  T& operator[](std::size_t i) { return const_cast<T&>(std::as_const(*this)[i]); }

  // Number of values for which there is memory behind the first.
  std::size_t capacity() const { return blocks_.size() * kBlockSize - first_; }

  // Returns the index of the first value for which the predicate does not hold, as it does for all
  // before: the size if there is none.
  template <class Predicate>
  std::size_t PartitionPoint(const Predicate& is_before) const {
    std::size_t first = 0;
    for (std::size_t length = size_; length > 0;) {
      const std::size_t half = length / 2;
      const bool is_behind = is_before((*this)[first + half]);
      first += is_behind ? half + 1 : 0;
      length = is_behind ? length - half - 1 : half;
    }
    return first;
  }

  void push_back(T value) {
    const std::size_t at = first_ + size_++;
    if (at / kBlockSize == blocks_.size()) blocks_.emplace_back(new T[kBlockSize]);
    blocks_[at / kBlockSize][at % kBlockSize] = std::move(value);
  }

  // Removes the first `count` values. Of the blocks at most half stay unused.
  void DropFirst(std::size_t count) {
    first_ += count;
    size_ -= count;
    const std::size_t gone = first_ / kBlockSize;
    first_ %= kBlockSize;
    std::rotate(blocks_.begin(), blocks_.begin() + static_cast<std::ptrdiff_t>(gone),
                blocks_.end());
    FreeUnused();
  }

  // Removes all but the first `count` values, likewise.
  void Truncate(std::size_t count) {
    size_ = count;
    FreeUnused();
  }

 private:
  void FreeUnused() {
    const std::size_t used = (first_ + size_) / kBlockSize + 1;
    if (blocks_.size() > 2 * used) blocks_.resize(2 * used);
  }

  static constexpr std::size_t kBlockSize = 512;

  std::vector<std::unique_ptr<T[]>> blocks_;
  std::size_t first_ = 0;  // of the values in the first block
  std::size_t size_ = 0;
};

}  // namespace unlidar
