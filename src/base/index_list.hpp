// A list of indices.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <utility>

#include "base/recording.hpp"

namespace unlidar {

// One index alone takes no memory beside the list: of plots among strays, which are hundreds of
// thousands, nearly all have one return.
class IndexList {
 public:
  IndexList() = default;
  template <class Iterator>
  IndexList(Iterator first, Iterator last) {
    for (; first != last; ++first) push_back(*first);
  }
  IndexList(std::initializer_list<std::uint32_t> indices)
      : IndexList(indices.begin(), indices.end()) {}
  IndexList(const IndexList& other) : IndexList(other.begin(), other.end()) {}
  IndexList(IndexList&& other) noexcept { *this = std::move(other); }
  IndexList& operator=(const IndexList& other) { return *this = IndexList(other); }
  IndexList& operator=(IndexList&& other) noexcept {
    many_ = std::move(other.many_);
    one_ = other.one_;
    size_ = std::exchange(other.size_, 0U);
    return *this;
  }
  ~IndexList() = default;

  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }
  const std::uint32_t* begin() const { return many_ ? many_.get() : &one_; }
  const std::uint32_t* end() const { return begin() + size_; }
  std::uint32_t front() const { return *begin(); }
  std::uint32_t operator[](std::size_t i) const { return begin()[i]; }
  operator IndexView() const { return {begin(), end()}; }  // NOLINT(google-explicit-constructor)

  // There is room for a power of two.
  void push_back(std::uint32_t index) {
    if (size_ > 0 && (size_ & (size_ - 1)) == 0) {
      std::unique_ptr<std::uint32_t[]> more(new std::uint32_t[2 * std::size_t{size_}]);
      std::copy(begin(), end(), more.get());
      many_ = std::move(more);
    }
    (many_ ? many_.get() : &one_)[size_++] = index;
  }

  void clear() { *this = IndexList(); }

 private:
  std::unique_ptr<std::uint32_t[]> many_;  // none: at most one
  std::uint32_t one_ = 0;
  std::uint32_t size_ = 0;
};

}  // namespace unlidar
