// FIFO queue in blocks of memory.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

namespace unlidar {

// For long queues: it grows without a copy and without room for as many values again. Blocks are
// reused, so that a queue that loses as much as it gains allocates nothing.
template <class T>
class BlockQueue {
 public:
  class ConstIterator {
   public:
    using iterator_category = std::random_access_iterator_tag;
    using value_type = T;
    using difference_type = std::ptrdiff_t;
    using pointer = const T*;
    using reference = const T&;

    ConstIterator() = default;
    ConstIterator(const BlockQueue& queue, std::size_t index)
        : queue_(&queue), index_(static_cast<difference_type>(index)) {}

    reference operator*() const { return (*queue_)[static_cast<std::size_t>(index_)]; }
    pointer operator->() const { return &**this; }
    ConstIterator& operator++() { return *this += 1; }
    ConstIterator& operator--() { return *this += -1; }
    ConstIterator& operator+=(difference_type step) {
      index_ += step;
      return *this;
    }
    friend difference_type operator-(const ConstIterator& a, const ConstIterator& b) {
      return a.index_ - b.index_;
    }
    friend bool operator==(const ConstIterator& a, const ConstIterator& b) {
      return a.index_ == b.index_;
    }
    friend bool operator!=(const ConstIterator& a, const ConstIterator& b) { return !(a == b); }

   private:
    const BlockQueue* queue_ = nullptr;
    difference_type index_ = 0;
  };

  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }
  ConstIterator begin() const { return {*this, 0}; }
  ConstIterator end() const { return {*this, size_}; }
  const T& front() const { return (*this)[0]; }
  const T& operator[](std::size_t i) const {
    return blocks_[(first_ + i) / kBlockSize][(first_ + i) % kBlockSize];
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
    const std::size_t used = (first_ + size_) / kBlockSize + 1;
    if (blocks_.size() > 2 * used) blocks_.resize(2 * used);
  }

 private:
  static constexpr std::size_t kBlockSize = 512;

  std::vector<std::unique_ptr<T[]>> blocks_;
  std::size_t first_ = 0;  // of the values in the first block
  std::size_t size_ = 0;
};

}  // namespace unlidar
