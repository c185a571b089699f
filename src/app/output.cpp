#include "app/output.hpp"

#include <nlohmann/json.hpp>
#include <optional>
#include <queue>
#include <utility>

#include "base/format.hpp"
#include "io/pcd.hpp"

namespace unlidar {
namespace {

void AppendVector(const Eigen::Vector3d& vector, char separator, std::string& text) {
  for (const double value : vector) {
    text += separator;
    text += FixedText(value, kMetreDigits);
  }
}

}  // namespace

std::string BlindedText(const std::string& name, double blinded_s) {
  return name + ": blinded for " + FixedText(blinded_s, 1) +
         " s: it did not see what it should (fog, snow, a covered window?)";
}

std::string NothingFoundText(const InputCounts& counts) {
  return "no drone found in " + Count(counts.frames, "frame") + " with " +
         Count(counts.returns, "return");
}

std::string ResultText(const std::string& path, std::uint64_t tracks, std::uint64_t rows,
                       std::uint64_t frames, std::size_t lidars) {
  return path + ": " + Count(tracks, "track") + ", " + Count(rows, "row") + ", from " +
         Count(frames, "frame") + " of " + Count(lidars, "LiDAR");
}

std::string TracksLeftOutText(std::size_t count) {
  return Count(count, "track") + " left out: surely a bird, by --only-drones";
}

std::string NotConvergedText(std::int64_t track_id, const MinimumReport& minimum) {
  return "track " + std::to_string(track_id) + ": Ceres did not converge in " +
         Count(static_cast<std::size_t>(minimum.iterations), "iteration") + " (" +
         minimum.termination + "); written is the minimum of the banded solver";
}

std::string JsonString(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string SecondsText(TimeNs time_ns) {
  constexpr std::uint64_t kUnit = kNsPerSecond;
  // Unsigned, so that the most negative time has a magnitude too.
  const auto bits = static_cast<std::uint64_t>(time_ns);
  const std::uint64_t magnitude = time_ns < 0 ? std::uint64_t{0} - bits : bits;
  const std::string fraction = std::to_string(magnitude % kUnit);
  return (time_ns < 0 ? "-" : "") + std::to_string(magnitude / kUnit) + "." +
         std::string(9 - fraction.size(), '0') + fraction;
}

void AppendTrajectoryRow(const TrajectoryRow& row, std::int64_t track_id, std::string& text) {
  text += SecondsText(row.time_ns) + "," + std::to_string(track_id);
  AppendVector(row.position_m, ',', text);
  AppendVector(row.velocity_mps, ',', text);
  AppendVector(row.sigma_m, ',', text);
  text += "," + std::to_string(row.support) + "\n";
}

void WriteTrajectoryCsv(const std::vector<RowStream>& tracks, const Sink& sink) {
  sink(kTrajectoryHeader);
  // The next row of each track, the first of all on top.
  using Next = std::pair<TrajectoryRow, const RowStream*>;
  const auto is_later = [](const Next& a, const Next& b) {
    return std::make_pair(a.first.time_ns, a.first.track_id) >
           std::make_pair(b.first.time_ns, b.first.track_id);
  };
  std::priority_queue<Next, std::vector<Next>, decltype(is_later)> queue(is_later);
  const auto push_next_of = [&](const RowStream& track) {
    if (const std::optional<TrajectoryRow> row = track()) queue.emplace(*row, &track);
  };
  for (const RowStream& track : tracks) push_next_of(track);
  while (!queue.empty()) {
    const auto [row, track] = queue.top();
    queue.pop();
    push_next_of(*track);
    std::string text;
    AppendTrajectoryRow(row, row.track_id, text);
    sink(text);
  }
}

void WriteTrajectoryTum(const RowStream& track, const Sink& sink) {
  sink("# timestamp tx ty tz qx qy qz qw\n");
  if (!track) return;
  while (const std::optional<TrajectoryRow> row = track()) {
    std::string text = SecondsText(row->time_ns);
    AppendVector(row->position_m, ' ', text);
    sink(text + " 0 0 0 1\n");
  }
}

std::string ClustersCsv(const std::vector<ClusterScore>& clusters) {
  std::string text =
      "id,rank,eligible,size,frames,windows,pairs,first,last,centroid_x,centroid_y,centroid_z,"
      "extent_x,extent_y,extent_z,volume_m3,local_volume_m3,merged_density_per_m3,"
      "local_density_per_m3,iou,relative_density,psi_iou,psi_rho,psi,von_neumann_ratio\n";
  for (const ClusterScore& cluster : clusters) {
    text += std::to_string(cluster.id) + "," + std::to_string(cluster.rank) + "," +
            (cluster.eligible ? "1," : "0,") + std::to_string(cluster.size) + "," +
            std::to_string(cluster.frames) + "," + std::to_string(cluster.windows) + "," +
            std::to_string(cluster.pairs) + "," + SecondsText(cluster.first_ns) + "," +
            SecondsText(cluster.last_ns);
    AppendVector(cluster.centroid_m, ',', text);
    AppendVector(cluster.extent_m, ',', text);
    // Densities and e^R span many orders of magnitude: all of their digits.
    for (const double value :
         {cluster.volume_m3, cluster.local_volume_m3, cluster.merged_density_per_m3,
          cluster.local_density_per_m3, cluster.iou, cluster.relative_density, cluster.psi_iou,
          cluster.psi_rho, cluster.psi, cluster.von_neumann_ratio}) {
      text += "," + ShortestText(value);
    }
    text += "\n";
  }
  return text;
}

std::string TargetPointsPcd(const Recording& recording, const std::vector<FittedTrack>& tracks) {
  std::vector<Eigen::Vector3f> points_m;
  for (const FittedTrack& track : tracks) {
    for (const std::uint32_t index : track.returns) points_m.push_back(recording.points_m[index]);
  }
  return BinaryPcd(points_m);
}

}  // namespace unlidar
