// The bytes of the output files. The same result gives the same bytes, whatever the locale.
#pragma once

#include <cstdint>
#include <string>
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

// `timestamp tx ty tz qx qy qz qw` lines of one track, the format of the TUM RGB-D benchmark.
// Returns of a point-like target say nothing about its attitude: the quaternion is always
// identity. Without a track (an empty stream): the comment line only.
void WriteTrajectoryTum(const RowStream& track, const Sink& sink);

// One row per global cluster, best first: every number of the paper's equations, see ClusterScore.
// Times in seconds, `eligible` is 1 or 0.
std::string ClustersCsv(const std::vector<ClusterScore>& clusters);

// The returns of all tracks, track by track, as binary PCD.
std::string TargetPointsPcd(const Recording& recording, const std::vector<FittedTrack>& tracks);

// Message about a LiDAR that was blinded for this long.
std::string BlindedText(const std::string& name, double blinded_s);

// End of a message that begins with a number of frames.
inline constexpr const char* kUnparsedText =
    " could not be parsed and skipped (input.skip_bad_frames)";

// Message about a run without tracks.
std::string NothingFoundText(const InputCounts& counts);

// Last line of a run.
std::string ResultText(const std::string& path, std::uint64_t tracks, std::uint64_t rows,
                       std::uint64_t frames, std::size_t lidars);

// Message about tracks that --only-drones leaves out.
std::string TracksLeftOutText(std::size_t count);

// Message about a track for which Ceres did not converge.
std::string NotConvergedText(std::int64_t track_id, const MinimumReport& minimum);

// "1706255621.600227000": exact, from integers.
std::string SecondsText(TimeNs time_ns);

// A text as JSON, quoted. Names of folders need not be UTF-8, JSON must be.
std::string JsonString(const std::string& text);

}  // namespace unlidar
