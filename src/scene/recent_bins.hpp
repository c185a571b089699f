// Sets of the most recent time bins, as bits, and the dwells in them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace unlidar {

// A set of the last kWindow time bins, each named by its age in bins: 0 is the newest.
class RecentBins {
 public:
  static constexpr int kWindow = 256;  // 128 s in bins of half a second

  // Index of a bin in a table of the window, counted from bin 0.
  static std::size_t SlotOf(std::int64_t bin) { return static_cast<std::size_t>(bin % kWindow); }

  void Insert(int age) { words_[WordOf(age)] |= BitOf(age); }
  bool Contains(int age) const { return (words_[WordOf(age)] & BitOf(age)) != 0; }
  bool IsEmpty() const { return *this == RecentBins(); }

  int Size() const {
    int size = 0;
    for (const std::uint64_t word : words_) size += CountBits(word);
    return size;
  }

  // Returns the smallest age; kWindow if empty.
  int Youngest() const {
    for (std::size_t w = 0; w < kWords; ++w) {
      if (words_[w] != 0) return static_cast<int>(w) * kBits + __builtin_ctzll(words_[w]);
    }
    return kWindow;
  }

  // Makes all bins older by `bins` >= 0; those that leave the window are dropped.
  void Age(std::int64_t bins) {
    if (bins <= 0) return;
    const auto by_words = static_cast<std::size_t>(std::min<std::int64_t>(bins / kBits, kWords));
    const auto by_bits = static_cast<unsigned>(bins % kBits);
    for (std::size_t w = kWords; w-- > 0;) {
      std::uint64_t word = w >= by_words ? words_[w - by_words] << by_bits : 0;
      if (by_bits > 0 && w > by_words) word |= words_[w - by_words - 1] >> (kBits - by_bits);
      words_[w] = word;
    }
  }

  RecentBins& operator|=(const RecentBins& other) {
    for (std::size_t w = 0; w < kWords; ++w) words_[w] |= other.words_[w];
    return *this;
  }

  friend bool operator==(const RecentBins& a, const RecentBins& b) { return a.words_ == b.words_; }
  friend bool operator!=(const RecentBins& a, const RecentBins& b) { return !(a == b); }

  friend RecentBins operator&(RecentBins a, const RecentBins& b) {
    for (std::size_t w = 0; w < kWords; ++w) a.words_[w] &= b.words_[w];
    return a;
  }

  // Returns the bins of `a` that are not in `b`.
  friend RecentBins operator-(RecentBins a, const RecentBins& b) {
    for (std::size_t w = 0; w < kWords; ++w) a.words_[w] &= ~b.words_[w];
    return a;
  }

  // Returns the number of these bins of ages outside [youngest, oldest].
  int SizeOutside(int youngest, int oldest) const {
    int size = 0;
    for (std::size_t w = 0; w < kWords; ++w) {
      const int first = static_cast<int>(w) * kBits;
      size += CountBits(words_[w] & ~(LowBits(oldest + 1 - first) & ~LowBits(youngest - first)));
    }
    return size;
  }

 private:
  static constexpr int kBits = 64;
  static constexpr std::size_t kWords = kWindow / kBits;

  // Most words are empty, and where packages must run there is no instruction for it: it is a call.
  static int CountBits(std::uint64_t word) { return word == 0 ? 0 : __builtin_popcountll(word); }

  static std::size_t WordOf(int age) { return static_cast<std::size_t>(age / kBits); }
  static std::uint64_t BitOf(int age) { return std::uint64_t{1} << (age % kBits); }
  static std::uint64_t LowBits(int count) {
    if (count <= 0) return 0;
    return count >= kBits ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1;
  }

  std::array<std::uint64_t, kWords> words_{};
};

// Bins around one, from the youngest to the oldest: how long a place has been occupied.
struct Dwell {
  int youngest;
  int oldest;
};

// Returns the dwell around the bin of age `at`, with breaks of at most `max_break` bins.
inline Dwell DwellAt(const RecentBins& hits, int at, int max_break) {
  Dwell dwell{at, at};
  for (int age = at - 1; age >= 0 && dwell.youngest - age <= max_break + 1; --age) {
    if (hits.Contains(age)) dwell.youngest = age;
  }
  for (int age = at + 1; age < RecentBins::kWindow && age - dwell.oldest <= max_break + 1; ++age) {
    if (hits.Contains(age)) dwell.oldest = age;
  }
  return dwell;
}

}  // namespace unlidar
