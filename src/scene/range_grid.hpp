// Voxels whose size grows with range, with one time profile each: what is where, and when.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/shell_table.hpp"

namespace unlidar {

// Time bins [first, last).
struct BinRange {
  std::uint32_t first = 0;
  std::uint32_t last = 0;
};

// A set of time bins that is filled and emptied again and again: in the time of one word per 64 of
// the bins between the lowest and the highest in it.
class BinSet {
 public:
  explicit BinSet(std::size_t num_bins) : words_(num_bins / kBits + 1, 0) {}

  void Insert(std::uint32_t bin) {
    const std::size_t word = bin / kBits;
    words_[word] |= std::uint64_t{1} << (bin % kBits);
    if (word < first_) first_ = word;
    if (word >= last_) last_ = word + 1;
  }

  // Moves all bins to the end of `bins`, in ascending order.
  void MoveTo(std::vector<std::uint32_t>* bins);

 private:
  static constexpr std::size_t kBits = 64;

  std::vector<std::uint64_t> words_;
  std::size_t first_ = words_.size();  // words [first_, last_) may hold bins
  std::size_t last_ = 0;
};

// Counts of points per voxel and time bin; voxels and neighbourhoods are those of ShellTable.
//
// What a grid holds, and what a look at it costs, is in proportion to the pairs of a voxel and a
// bin with points in it, however many bins there are.
class RangeGrid {
 public:
  explicit RangeGrid(RangeRadius radius) : places_(radius) {}

  // Returns the place of the point: points of one place have one neighbourhood. Places are numbered
  // from 0; some numbers are those of no point.
  std::uint32_t Add(const Eigen::Vector3f& point_m, std::uint32_t bin, std::uint32_t count = 1);

  // Says that a point will be added soon, so that its place is at hand by then.
  void Prefetch(const Eigen::Vector3f& point_m) const { places_.Prefetch(point_m); }

  // Points in the neighbourhood of `point_m`, in all bins or in some.
  std::uint32_t Count(const Eigen::Vector3f& point_m) const;
  std::uint32_t Count(const Eigen::Vector3f& point_m, BinRange bins) const;

  // The bins in which the neighbourhood of `point_m` has points.
  void InsertBins(const Eigen::Vector3f& point_m, BinSet* bins) const;

  // Volume of the neighbourhood of a point, m^3.
  double VolumeM3(const Eigen::Vector3f& point_m) const { return places_.VolumeM3(point_m); }

  // Above all numbers of places.
  std::uint32_t num_places() const { return places_.size(); }

 private:
  struct BinCount {
    std::uint32_t bin;
    std::uint32_t count;
  };

  static bool IsEarlier(const BinCount& a, std::uint32_t bin) { return a.bin < bin; }

  struct Profile {
    std::uint32_t total = 0;
    BinCount latest = {0, 0};    // the last bin with points, here as most points fall into it,
    std::vector<BinCount> bins;  // and those before it with points, ascending
  };

  ShellTable<Profile> places_;
};

}  // namespace unlidar
