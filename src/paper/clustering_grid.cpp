// The default engine: an exact cell grid with union-find.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "base/algorithms.hpp"
#include "base/disjoint_sets.hpp"
#include "paper/clustering.hpp"

namespace unlidar {
namespace {

constexpr std::uint32_t kUnlabelled = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint32_t kDirectCells = 1U << 22U;  // on longer axes gaps are closed
constexpr std::uint32_t kBorderCells = 2;          // searches reach two cells below
constexpr std::uint32_t kReach = 2;

// A non-empty cell; its points are [begin, end) of the sorted points, core points first.
struct Cell {
  std::uint64_t column = 0;  // x number << 32 | y number
  std::uint32_t z = 0;
  std::uint32_t begin = 0;
  std::uint32_t core_end = 0;
  std::uint32_t end = 0;

  bool Precedes(std::uint64_t other_column, std::uint32_t other_z) const {
    return column != other_column ? column < other_column : z < other_z;
  }
};

struct Grid {
  std::vector<Cell> cells;                // in order of (x, y, z)
  std::vector<Eigen::Vector3f> points_m;  // by cell
  std::vector<std::uint32_t> indices;     // of points_m in the input
};

struct Slot {
  std::array<std::uint32_t, 3> cell;
  std::uint32_t index;
};

// Numbers the cells along one axis. Neighbouring cells keep their distance; on a long axis, gaps
// beyond the reach of a search are closed, so that a return at 1e30 m costs no more than one at 10
// m. At such coordinates adjacent floats are many cells apart and equal ones share a cell, so the
// lost resolution of the quotient does no harm.
void NumberCells(const std::vector<Eigen::Vector3f>& points_m, Eigen::Index axis, double side_m,
                 std::vector<Slot>& slots) {
  const double cells_per_m = 1.0 / side_m;
  std::vector<double> quotients(points_m.size());
  double lowest = std::numeric_limits<double>::infinity();
  double highest = -lowest;
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    const double quotient = std::floor(static_cast<double>(points_m[i][axis]) * cells_per_m);
    quotients[i] = quotient;
    lowest = std::min(lowest, quotient);
    highest = std::max(highest, quotient);
  }
  const auto a = static_cast<std::size_t>(axis);
  if (highest - lowest < kDirectCells) {
    for (std::size_t i = 0; i < slots.size(); ++i) {
      slots[i].cell[a] = kBorderCells + static_cast<std::uint32_t>(quotients[i] - lowest);
    }
    return;
  }
  const std::vector<double> distinct = SortedUnique(quotients);
  std::vector<std::uint32_t> numbers(distinct.size(), kBorderCells);
  for (std::size_t i = 1; i < distinct.size(); ++i) {
    const double gap = std::min(distinct[i] - distinct[i - 1], kReach + 1.0);
    numbers[i] = numbers[i - 1] + static_cast<std::uint32_t>(gap);
  }
  for (std::size_t i = 0; i < slots.size(); ++i) {
    const auto at = std::lower_bound(distinct.begin(), distinct.end(), quotients[i]);
    slots[i].cell[a] = numbers[static_cast<std::size_t>(at - distinct.begin())];
  }
}

// Stable radix sort by the cell number along one axis.
void SortByAxis(std::size_t axis, std::vector<Slot>& slots, std::vector<Slot>& buffer) {
  constexpr std::uint32_t kBits = 11;
  constexpr std::uint32_t kMask = (1U << kBits) - 1U;
  std::uint32_t highest = 0;
  for (const Slot& slot : slots) highest = std::max(highest, slot.cell[axis]);
  for (std::uint32_t shift = 0; shift < 32 && (highest >> shift) != 0; shift += kBits) {
    std::array<std::uint32_t, kMask + 1> starts{};
    for (const Slot& slot : slots) ++starts[(slot.cell[axis] >> shift) & kMask];
    std::uint32_t total = 0;
    for (std::uint32_t& start : starts) total += std::exchange(start, total);
    for (const Slot& slot : slots) buffer[starts[(slot.cell[axis] >> shift) & kMask]++] = slot;
    slots.swap(buffer);
  }
}

Grid BuildGrid(const std::vector<Eigen::Vector3f>& points_m, double side_m) {
  std::vector<Slot> slots(points_m.size());
  for (std::size_t i = 0; i < slots.size(); ++i) slots[i].index = static_cast<std::uint32_t>(i);
  for (Eigen::Index axis = 0; axis < 3; ++axis) NumberCells(points_m, axis, side_m, slots);
  std::vector<Slot> buffer(slots.size());
  for (const std::size_t axis : {2U, 1U, 0U}) SortByAxis(axis, slots, buffer);

  Grid grid;
  grid.points_m.reserve(slots.size());
  grid.indices.reserve(slots.size());
  for (const Slot& slot : slots) {
    const std::uint64_t column = (std::uint64_t{slot.cell[0]} << 32U) | slot.cell[1];
    const auto here = static_cast<std::uint32_t>(grid.indices.size());
    if (grid.cells.empty() || grid.cells.back().column != column ||
        grid.cells.back().z != slot.cell[2]) {
      grid.cells.push_back({column, slot.cell[2], here, here, here});
    }
    ++grid.cells.back().end;
    grid.points_m.push_back(points_m[slot.index]);
    grid.indices.push_back(slot.index);
  }
  return grid;
}

// Calls visit(i, j) for every non-empty cell j within `reach` cells of cell i along each axis; with
// `half`, only for j > i. Since the cells are sorted, the start of the search in each neighbouring
// column only moves forward.
template <typename Visit>
void VisitNeighbours(const std::vector<Cell>& cells, std::uint32_t reach, bool half, Visit visit) {
  struct Column {
    std::uint64_t offset;  // wraps around for lower columns
    std::size_t start;
  };
  std::vector<Column> columns;
  const auto signed_reach = static_cast<std::int64_t>(reach);
  for (std::int64_t dx = half ? 0 : -signed_reach; dx <= signed_reach; ++dx) {
    for (std::int64_t dy = half && dx == 0 ? 0 : -signed_reach; dy <= signed_reach; ++dy) {
      columns.push_back({static_cast<std::uint64_t>(dx * (std::int64_t{1} << 32) + dy), 0});
    }
  }
  for (std::size_t i = 0; i < cells.size(); ++i) {
    for (Column& column : columns) {
      const std::uint64_t wanted = cells[i].column + column.offset;
      const std::uint32_t lowest_z = cells[i].z - reach;
      std::size_t j = column.start;
      while (j < cells.size() && cells[j].Precedes(wanted, lowest_z)) ++j;
      column.start = j;
      if (half) j = std::max(j, i + 1);
      for (; j < cells.size() && cells[j].column == wanted && cells[j].z <= cells[i].z + reach;
           ++j) {
        if (j != i) visit(i, j);
      }
    }
  }
}

// Moves the core points of each cell to the front. A point is core if at least `min_neighbours`
// points, itself included, are near it; in a cell with that many points all are core.
template <typename Rule>
void SortOutCorePoints(const Rule& rule, std::uint32_t min_neighbours, Grid& grid) {
  const auto is_full = [&](const Cell& cell) { return cell.end - cell.begin >= min_neighbours; };
  std::vector<std::uint32_t> counts(grid.points_m.size(), 0);
  for (Cell& cell : grid.cells) {
    cell.core_end = cell.end;
    for (std::uint32_t a = cell.begin; a < cell.end; ++a) counts[a] = cell.end - cell.begin;
  }
  if (min_neighbours <= 1) return;
  VisitNeighbours(grid.cells, kReach, false, [&](std::size_t i, std::size_t j) {
    const Cell& cell = grid.cells[i];
    if (is_full(cell)) return;
    for (std::uint32_t a = cell.begin; a < cell.end; ++a) {
      for (std::uint32_t b = grid.cells[j].begin;
           b < grid.cells[j].end && counts[a] < min_neighbours; ++b) {
        if (rule.Near(grid.points_m[a], grid.points_m[b])) ++counts[a];
      }
    }
  });
  for (Cell& cell : grid.cells) {
    if (is_full(cell)) continue;
    std::uint32_t core_end = cell.begin;
    for (std::uint32_t a = cell.begin; a < cell.end; ++a) {
      if (counts[a] < min_neighbours) continue;
      std::swap(grid.points_m[a], grid.points_m[core_end]);
      std::swap(grid.indices[a], grid.indices[core_end]);
      ++core_end;
    }
    cell.core_end = core_end;
  }
}

// Bounding boxes of the core points of each cell, to exclude pairs that cannot be neighbours.
class CoreBoxes {
 public:
  CoreBoxes(const Grid& grid, double squared_radius_m2)
      : boxes_(grid.cells.size()),
        // Exceeds the radius by more than the rounding errors of the rules.
        squared_limit_m2_(static_cast<float>(squared_radius_m2 * (1.0 + 1e-5))) {
    for (std::size_t i = 0; i < boxes_.size(); ++i) {
      for (std::uint32_t a = grid.cells[i].begin; a < grid.cells[i].core_end; ++a) {
        boxes_[i].extend(grid.points_m[a]);
      }
    }
  }
  bool MayTouch(std::size_t i, std::size_t j) const {
    return boxes_[i].squaredExteriorDistance(boxes_[j]) <= squared_limit_m2_;
  }
  bool MayTouch(std::size_t i, const Eigen::Vector3f& point_m) const {
    return boxes_[i].squaredExteriorDistance(point_m) <= squared_limit_m2_;
  }

 private:
  std::vector<Eigen::AlignedBox3f> boxes_;
  float squared_limit_m2_;
};

// Joins cells that contain neighbouring core points. Adjacent cells come first: most distant ones
// are then already joined and need no tests of points. The boxes avoid testing all pairs of points
// in crowded cells of long recordings.
template <typename Rule>
DisjointSets JoinCells(const Rule& rule, const Grid& grid) {
  const CoreBoxes boxes(grid, rule.squared_radius_m2);
  DisjointSets sets(grid.cells.size());
  for (const std::uint32_t reach : {1U, kReach}) {
    VisitNeighbours(grid.cells, reach, true, [&](std::size_t i, std::size_t j) {
      const Cell& cell_i = grid.cells[i];
      const Cell& cell_j = grid.cells[j];
      if (cell_i.core_end == cell_i.begin || cell_j.core_end == cell_j.begin) return;
      const std::size_t root_i = sets.Find(i);
      const std::size_t root_j = sets.Find(j);
      if (root_i == root_j || !boxes.MayTouch(i, j)) return;
      for (std::uint32_t a = cell_i.begin; a < cell_i.core_end; ++a) {
        if (!boxes.MayTouch(j, grid.points_m[a])) continue;
        for (std::uint32_t b = cell_j.begin; b < cell_j.core_end; ++b) {
          if (rule.Near(grid.points_m[a], grid.points_m[b])) {
            sets.Join(i, j);
            return;
          }
        }
      }
    });
  }
  return sets;
}

// Numbers the clusters by their lowest core index.
Clustering LabelCorePoints(const Grid& grid, DisjointSets& sets) {
  std::vector<std::uint32_t> lowest_index(grid.cells.size(), kUnlabelled);  // per set, at root
  for (std::size_t i = 0; i < grid.cells.size(); ++i) {
    std::uint32_t& lowest = lowest_index[sets.Find(i)];
    for (std::uint32_t a = grid.cells[i].begin; a < grid.cells[i].core_end; ++a) {
      lowest = std::min(lowest, grid.indices[a]);
    }
  }
  std::vector<std::size_t> roots;
  for (std::size_t i = 0; i < lowest_index.size(); ++i) {
    if (lowest_index[i] != kUnlabelled) roots.push_back(i);
  }
  std::sort(roots.begin(), roots.end(),
            [&](std::size_t a, std::size_t b) { return lowest_index[a] < lowest_index[b]; });
  std::vector<std::int32_t> label_of_root(grid.cells.size(), kNoise);
  Clustering result;
  for (const std::size_t root : roots) label_of_root[root] = result.num_clusters++;
  result.labels.assign(grid.indices.size(), kNoise);
  for (std::size_t i = 0; i < grid.cells.size(); ++i) {
    const std::int32_t label = label_of_root[sets.Find(i)];
    for (std::uint32_t a = grid.cells[i].begin; a < grid.cells[i].core_end; ++a) {
      result.labels[grid.indices[a]] = label;
    }
  }
  return result;
}

// Assigns border points to the lowest-numbered cluster in reach.
template <typename Rule>
void LabelBorderPoints(const Rule& rule, const Grid& grid, Clustering& result) {
  std::vector<std::int32_t> cell_labels(grid.cells.size(), kNoise);
  const auto offer = [](std::int32_t label, std::int32_t& current) {
    if (current == kNoise || label < current) current = label;
  };
  for (std::size_t i = 0; i < grid.cells.size(); ++i) {
    const Cell& cell = grid.cells[i];
    if (cell.core_end == cell.begin) continue;
    cell_labels[i] = result.labels[grid.indices[cell.begin]];
    for (std::uint32_t a = cell.core_end; a < cell.end; ++a) {
      offer(cell_labels[i], result.labels[grid.indices[a]]);
    }
  }
  VisitNeighbours(grid.cells, kReach, false, [&](std::size_t i, std::size_t j) {
    if (cell_labels[j] == kNoise) return;
    for (std::uint32_t a = grid.cells[i].core_end; a < grid.cells[i].end; ++a) {
      std::int32_t& label = result.labels[grid.indices[a]];
      if (label != kNoise && label <= cell_labels[j]) continue;
      for (std::uint32_t b = grid.cells[j].begin; b < grid.cells[j].core_end; ++b) {
        if (!rule.Near(grid.points_m[a], grid.points_m[b])) continue;
        label = cell_labels[j];
        break;
      }
    }
  });
}

// Euclidean clustering is DBSCAN with every point core.
template <typename Rule>
Clustering ClusterWithRule(const std::vector<Eigen::Vector3f>& points_m, const Rule& rule,
                           std::uint32_t min_neighbours) {
  // All points of a cell are neighbours even with the rounding errors of the rule, which are below
  // 1e-6 of the radius; points three cells apart are at least 1.15 radii apart and never
  // neighbours.
  const double side_m = std::sqrt(static_cast<double>(rule.squared_radius_m2) / 3.0) * (1.0 - 1e-6);
  Grid grid = BuildGrid(points_m, side_m);
  SortOutCorePoints(rule, min_neighbours, grid);
  DisjointSets sets = JoinCells(rule, grid);
  Clustering result = LabelCorePoints(grid, sets);
  if (min_neighbours > 1) LabelBorderPoints(rule, grid, result);
  return result;
}

}  // namespace

Clustering ClusterByGrid(const std::vector<Eigen::Vector3f>& points_m,
                         const ClusteringConfig& config) {
  if (config.method == ClusterMethod::kEuclidean) {
    return ClusterWithRule(points_m, EuclideanRule(config.tolerance_m), 1);
  }
  return ClusterWithRule(points_m, DbscanRule(config.tolerance_m),
                         static_cast<std::uint32_t>(config.min_neighbours));
}

}  // namespace unlidar
