// The bytes of the output files. The same result gives the same bytes, whatever the locale.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "app/output_files.hpp"
#include "recording/pipeline.hpp"

namespace unlidar {

inline constexpr int kMetreDigits = 6;  // of lengths, speeds and their sigmas

// timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support - one row per track and output
// time, in order of (time, track). Seconds with nine digits, metres, m/s; header only without a
// track. Takes the rows from the streams, one of each track, as it writes.
void WriteTrajectoryCsv(const std::vector<RowStream>& tracks, const Sink& sink);
inline constexpr const char* kTrajectoryHeader =
    "timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support\n";
void AppendTrajectoryRow(const TrajectoryRow& row, std::int64_t track_id, std::string& text);

// Calls visit(name, value) for position, velocity and their sigmas, as the columns are named.
template <class Visit>
void VisitState(const TrajectoryRow& row, const Visit& visit) {
  for (const auto& [prefix, vector] :
       {std::pair{"", &row.position_m}, {"v", &row.velocity_mps}, {"sigma_", &row.sigma_m}}) {
    for (int axis = 0; axis < 3; ++axis)
      visit(prefix + std::string(1, "xyz"[axis]), (*vector)[axis]);
  }
}

// `timestamp tx ty tz qx qy qz qw` lines of one track, the format of the TUM RGB-D benchmark.
// Returns of a point-like target say nothing about its attitude: the quaternion is always
// identity. Without a track (an empty stream): the comment line only.
void WriteTrajectoryTum(const RowStream& track, const Sink& sink);

// One row per global cluster, best first: every number of the paper's equations, see ClusterScore.
// Times in seconds, `eligible` is 1 or 0.
std::string ClustersCsv(const std::vector<ClusterScore>& clusters);

// The returns of all tracks, track by track, as binary PCD.
std::string TargetPointsPcd(const Recording& recording, const std::vector<FittedTrack>& tracks);

// Lines for the user: about a LiDAR that was blinded, a run without tracks, tracks that
// --only-drones leaves out, a track for which Ceres did not converge; the last line of a run.
std::string BlindedText(const std::string& name, double blinded_s);
std::string NothingFoundText(const InputCounts& counts);
std::string TracksLeftOutText(std::size_t count);
std::string NotConvergedText(std::int64_t track_id, const MinimumReport& minimum);
std::string ResultText(const std::string& path, std::uint64_t tracks, std::uint64_t rows,
                       std::uint64_t frames, std::size_t lidars);

// True if a count has reached 1, 2, 4, 8, ... since it was `before`: repeated incidents are noted
// ever less often.
inline bool IsWorthANote(std::uint64_t before, std::uint64_t count) {
  return (before ^ count) > before;  // a higher bit is set
}

// Ends of lines that begin with a number of frames, or of rows: as they are told of in passing and
// at the end.
inline constexpr const char* kUnparsedText =
    " could not be parsed and skipped (input.skip_bad_frames)";
inline constexpr const char* kVanishedText = " removed before it could be read";
inline constexpr const char* kPassedOverText = " passed over: the stamp had come before";
inline constexpr const char* kAlreadyProcessedText =
    " passed over: worked off by an earlier run, as the rows of --out tell";
inline constexpr const char* kOverflowText =
    " left out: more than may wait for live.reorder_s (4,096, or 192 MB)";
inline constexpr const char* kUnwritableText =
    " left out: a number in it is none, or beyond 1e9, which no output takes";

// "1706255621.600227000": exact, from integers.
std::string SecondsText(TimeNs time_ns);

// A text as JSON, quoted. Names of folders need not be UTF-8, JSON must be.
std::string JsonString(const std::string& text);

}  // namespace unlidar
