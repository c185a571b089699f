// A small recording with any settings, from frame files to trajectory rows: what is promised of
// every row, and the same again in a second run.
//
// The input is a program that builds the scene: four bytes of switches, then instructions of eight
// bytes. So mutation makes flights, clutter and gaps, and does not stop at the first header.
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "app/output.hpp"
#include "config/config_keys.hpp"
#include "fuzz/fuzz.hpp"
#include "io/pcd.hpp"
#include "pcl/pcl_clustering.hpp"
#include "recording/pipeline.hpp"

namespace unlidar::fuzz {
namespace {

constexpr TimeNs kBeginNs = 1'706'255'621'000'000'000;
constexpr std::size_t kMaxReturns = 600;
constexpr int kMaxFrames = 16;

enum class PointTimes { kNone, kOffset, kUnix };

// A frame of one sensor, as its file will have it.
struct SceneFrame {
  TimeNs stamp_ns = 0;
  bool dropped = false;
  std::vector<Eigen::Vector3f> points_m;
};

class Scene {
 public:
  explicit Scene(ByteReader reader) {
    const std::uint8_t switches = reader.Byte();
    num_sensors_ = 1 + (switches & 1);
    times_ = static_cast<PointTimes>((switches >> 1) % 3);
    config.method = (switches & 8) != 0 ? Method::kPaper : Method::kRobust;
    config.input.stamp = static_cast<StampMeaning>((switches >> 4) % 3);
    config.input.min_range_m = 0.0;
    const std::size_t num_frames = 1 + reader.Byte() % kMaxFrames;
    // 1 ms, 10 ms, 100 ms (as LiDARs do), ..., 10,000 s.
    const TimeNs period_ns = 1'000'000 * static_cast<TimeNs>(std::pow(10, (2 + reader.Byte()) % 8));
    const std::uint8_t rate = reader.Byte();
    if (rate > 0) request.output_times = Rate{rate * (1'000'000'000'000'000 / period_ns)};
    for (int s = 0; s < num_sensors_; ++s) {
      std::vector<SceneFrame>& frames = frames_.emplace_back(num_frames);
      for (std::size_t i = 0; i < num_frames; ++i) {
        frames[i].stamp_ns = kBeginNs + static_cast<TimeNs>(i) * period_ns + s * period_ns / 3;
      }
    }
    while (!reader.empty()) Follow(reader);
  }

  void Write(const ScratchFolder& scratch) {
    request.sources.clear();
    for (int s = 0; s < num_sensors_; ++s) {
      const std::string name(1, static_cast<char>('a' + s));
      const std::string folder = scratch.Empty(name);
      request.sources.push_back({name, folder});
      for (const SceneFrame& frame : frames_[static_cast<std::size_t>(s)]) {
        if (frame.dropped) continue;
        WriteFile(folder + "/" + SecondsText(frame.stamp_ns) + ".pcd", Pcd(frame));
      }
    }
  }

  Config config;
  PipelineRequest request;

 private:
  // One instruction: what, and seven bytes for it.
  void Follow(ByteReader& reader) {
    const std::uint8_t what = reader.Byte();
    std::array<std::uint8_t, 7> rest{};
    for (std::uint8_t& byte : rest) byte = reader.Byte();
    ByteReader bytes({reinterpret_cast<const char*>(rest.data()), rest.size()});
    std::vector<SceneFrame>& frames = frames_[(what >> 4) % frames_.size()];
    switch (what % 8) {
      case 0:
      case 1:
        return AddThing(bytes, what % 8 == 1, frames);
      case 2:
        return AddBlob(bytes, frames);
      case 3:
        return AddAnything(bytes, frames);
      case 4:
        return DropFrames(bytes, frames);
      case 5:
        return MoveStamps(bytes, frames);
      default:
        return Set(bytes);
    }
  }

  // A thing at a place, hit in some frames; one that flies moves.
  void AddThing(ByteReader& bytes, bool flies, std::vector<SceneFrame>& frames) {
    const Eigen::Vector3d place_m(bytes.Within(30), bytes.Within(30), bytes.Within(15));
    const double noise_m = 0.3 * std::pow(bytes.Share(), 2.0);
    const int hits = bytes.Byte() % 16;
    const Eigen::Vector3d step_m =
        flies ? Eigen::Vector3d(bytes.Within(4), bytes.Within(4), 0.0) : Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < frames.size(); ++i) {
      for (int k = 0; k < hits; ++k) {
        Add(place_m + static_cast<double>(i) * step_m + noise_m * Noise(), frames[i]);
      }
    }
  }

  // Many returns close together in one frame.
  void AddBlob(ByteReader& bytes, std::vector<SceneFrame>& frames) {
    SceneFrame& frame = frames[bytes.Byte() % frames.size()];
    const Eigen::Vector3d place_m(bytes.Within(30), bytes.Within(30), bytes.Within(15));
    const double size_m = bytes.Share();
    for (int k = bytes.Byte(); k > 0; --k) Add(place_m + size_m * Noise(), frame);
  }

  // A return with coordinates of any magnitude.
  void AddAnything(ByteReader& bytes, std::vector<SceneFrame>& frames) {
    static const std::array<float, 16> values = {0.0F,
                                                 -0.0F,
                                                 1e-38F,
                                                 1e-45F,
                                                 1e-6F,
                                                 -0.5F,
                                                 1.0F,
                                                 -2.0F,
                                                 1999.0F,
                                                 2001.0F,
                                                 1e5F,
                                                 -1e18F,
                                                 3e38F,
                                                 -3e38F,
                                                 std::numeric_limits<float>::infinity(),
                                                 std::numeric_limits<float>::quiet_NaN()};
    SceneFrame& frame = frames[bytes.Byte() % frames.size()];
    for (int k = 0; k < 2; ++k) {
      const auto value = [&] { return values[bytes.Byte() % values.size()]; };
      const float x = value();
      const float y = value();
      const float z = value();
      if (++num_returns_ <= kMaxReturns) frame.points_m.emplace_back(x, y, z);
    }
  }

  static void DropFrames(ByteReader& bytes, std::vector<SceneFrame>& frames) {
    const std::size_t begin = bytes.Byte() % frames.size();
    const std::size_t end = std::min(frames.size(), begin + 1 + bytes.Byte() % 16);
    for (std::size_t i = begin; i < end; ++i) frames[i].dropped = true;
  }

  // From a frame on by microseconds to years.
  static void MoveStamps(ByteReader& bytes, std::vector<SceneFrame>& frames) {
    const std::size_t begin = bytes.Byte() % frames.size();
    const double by_ns = bytes.Within(4.0) * std::pow(10.0, 3 + bytes.Byte() % 14);
    for (std::size_t i = begin; i < frames.size(); ++i) {
      frames[i].stamp_ns += static_cast<TimeNs>(by_ns);
    }
  }

  // Any key to any value that it may have.
  void Set(ByteReader& bytes) {
    const int chosen = bytes.Byte();
    int index = 0;
    VisitKeys(
        [&](const std::string&, auto& field, const auto& constraint) {
          if (index++ == chosen) SetField(bytes, field, constraint);
        },
        config);
  }

  template <typename Field, typename Constraint>
  static void SetField(ByteReader& bytes, Field& field, const Constraint& constraint) {
    if constexpr (std::is_same_v<Constraint, Range>) {
      // Between the ends, the nearer to the present value the likelier.
      const double share = bytes.Within(1.0);
      const double end = share < 0.0 ? constraint.low : constraint.high;
      const double now = static_cast<double>(field);
      const double value = now + std::pow(std::abs(share), 3.0) * (end - now);
      if (value == constraint.low && !constraint.low_is_allowed) return;
      field = static_cast<Field>(value);
    } else if constexpr (std::is_enum_v<Field>) {
      field = constraint.names[bytes.Byte() % constraint.names.size()].second;
    }
  }

  void Add(const Eigen::Vector3d& point_m, SceneFrame& frame) {
    if (++num_returns_ <= kMaxReturns) frame.points_m.push_back(point_m.cast<float>());
  }

  // Even in a cube of edge 2, the same for the same input.
  Eigen::Vector3d Noise() {
    const auto next = [this] {
      random_ = random_ * 6364136223846793005U + 1442695040888963407U;
      return static_cast<double>(random_ >> 33) / static_cast<double>(1U << 30) - 1.0;
    };
    const double x = next();
    const double y = next();
    const double z = next();
    return {x, y, z};
  }

  std::string Pcd(const SceneFrame& frame) const {
    if (times_ == PointTimes::kNone) return BinaryPcd(frame.points_m);
    const std::string count = std::to_string(frame.points_m.size());
    std::string bytes =
        "FIELDS x y z t\nSIZE 4 4 4 8\nTYPE F F F U\nWIDTH " + count + "\nDATA binary\n";
    for (std::size_t i = 0; i < frame.points_m.size(); ++i) {
      const auto offset_ns = static_cast<TimeNs>(i * 99'000'000 / frame.points_m.size());
      const TimeNs time_ns = times_ == PointTimes::kUnix ? frame.stamp_ns + offset_ns : offset_ns;
      std::array<char, 20> row{};
      std::memcpy(row.data(), frame.points_m[i].data(), 12);
      std::memcpy(row.data() + 12, &time_ns, 8);
      bytes.append(row.data(), row.size());
    }
    return bytes;
  }

  int num_sensors_ = 1;
  PointTimes times_ = PointTimes::kNone;
  std::vector<std::vector<SceneFrame>> frames_;
  std::size_t num_returns_ = 0;
  std::uint64_t random_ = 1;
};

void RequireSoundRow(const TrajectoryRow& row, double max_sigma_m) {
  Require(row.position_m.allFinite() && row.velocity_mps.allFinite(), "a row is finite");
  Require(row.sigma_m.minCoeff() > 0.0 && row.sigma_m.maxCoeff() <= max_sigma_m,
          "sigmas are above 0 and within their bound");
  Require(row.support >= 0, "a row has returns or none behind it");
}

void RequireSound(const PipelineResult& result, const Config& config) {
  const Recording& recording = result.recording;
  TimeNs begin_ns = std::numeric_limits<TimeNs>::max();
  TimeNs end_ns = std::numeric_limits<TimeNs>::min();
  for (const FrameInfo& frame : recording.frames) {
    begin_ns = std::min(begin_ns, frame.begin_ns);
    end_ns = std::max(end_ns, frame.end_ns);
  }
  std::set<std::uint32_t> taken;
  TimeNs previous_begin_ns = begin_ns;
  for (std::size_t i = 0; i < result.tracks.size(); ++i) {
    const FittedTrack& track = result.tracks[i];
    Require(track.id() == static_cast<int>(i), "ids count from 0");
    Require(previous_begin_ns <= track.begin_ns(), "tracks are in order of first evidence");
    previous_begin_ns = track.begin_ns();
    Require(track.begin_ns() <= track.end_ns() && track.end_ns() <= end_ns,
            "evidence is in frames");
    Require(std::isfinite(track.score), "a score is finite");
    Require(std::isfinite(track.length_m) && track.length_m >= 0.0, "a length is finite");
    Require(!track.returns.empty(), "a track has returns");
    for (const std::uint32_t index : track.returns) {
      Require(index < recording.points_m.size(), "a return is in the recording");
      Require(taken.insert(index).second, "a return is in one track, once");
    }
    std::size_t support = 0;
    std::size_t num_rows = 0;
    TimeNs previous_ns = std::numeric_limits<TimeNs>::min();
    const RowStream next = RowsOf(result, track);
    while (const std::optional<TrajectoryRow> row = next()) {
      RequireSoundRow(*row, config.trajectory.max_sigma_m);
      Require(row->track_id == track.id(), "a row has the id of its track");
      Require(previous_ns < row->time_ns, "rows are in order");
      Require(begin_ns <= row->time_ns && row->time_ns <= end_ns, "rows are in the recording");
      previous_ns = row->time_ns;
      support += static_cast<std::size_t>(row->support);
      ++num_rows;
    }
    Require(num_rows == track.num_rows, "rows are as many as were counted");
    Require(num_rows == 0 || support == track.returns.size(), "each return is behind one row");
  }
}

std::string Outputs(const PipelineResult& result) {
  std::vector<RowStream> rows;
  for (const FittedTrack& track : result.tracks) rows.push_back(RowsOf(result, track));
  std::string text;
  WriteTrajectoryCsv(rows, [&](std::string_view piece) { text += piece; });
  return text + TargetPointsPcd(result.recording, result.tracks);
}

void Run(std::string_view bytes) {
  static const ScratchFolder scratch;
  Scene scene{ByteReader(bytes)};
  scene.Write(scratch);
  const auto silent = [](const StageTime&, const std::string&) {};
  PipelineResult result;
  UsePclClustering();
  const auto run = [&] { result = RunPipeline(scene.request, scene.config, silent); };
  if (!Succeeds(run)) return;
  RequireSound(result, scene.config);
  const std::string outputs = Outputs(result);
  run();
  Require(Outputs(result) == outputs, "the same input gives the same output");
}

}  // namespace
}  // namespace unlidar::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  unlidar::fuzz::Run(unlidar::fuzz::Text(data, size));
  return 0;
}
