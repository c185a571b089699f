#include "app/live_event_reporter.hpp"

#include <utility>
#include <variant>

#include "app/output.hpp"
#include "base/format.hpp"

namespace unlidar {
namespace {

// Two thirds of the time after which readers consider an engine stopped.
constexpr TimeNs kStateIntervalNs = 40'000'000'000;

}  // namespace

void LiveEventReporter::NoteCount(std::uint64_t before, std::uint64_t count,
                                  const std::string& noun, const std::string& text) const {
  if (IsWorthANote(before, count)) Note(Count(count, noun) + text);
}

void LiveEventReporter::Take(const EngineEvent& event, const LiveProgress& now) {
  if (const auto* confirmed = std::get_if<TrackConfirmed>(&event)) {
    output_.Confirm(*confirmed);
  } else if (const auto* given = std::get_if<RowGiven>(&event)) {
    const std::uint64_t unwritable = output_.counts().unwritable_rows;
    output_.AddRow(now.newest_ns, *given);
    NoteCount(unwritable, output_.counts().unwritable_rows, "row", kUnwritableText);
  } else if (const auto* predicted = std::get_if<TrackPredicted>(&event)) {
    output_.AddPrediction(now.newest_ns, *predicted);
  } else if (const auto* ended = std::get_if<TrackEnded>(&event)) {
    output_.End(now.newest_ns, *ended);
  } else if (const auto* changed = std::get_if<SensorChanged>(&event)) {
    ReportSensor(changed->sensor, changed->state, now.newest_ns);
  } else {
    OnEngineState(std::get<EngineState>(event), now);
  }
}

void LiveEventReporter::OnEngineState(EngineState state, const LiveProgress& now) {
  const bool is_beginning = state == EngineState::kWarmingUp;
  state_ = is_beginning ? LiveState::kWarmingUp : LiveState::kRunning;
  if (is_beginning && std::exchange(has_begun_, true)) {
    Note("begins anew at " + SecondsText(now.newest_ns) +
         ": the clock has gone back, or no frame came for longer than live.window_s");
  }
  state_reported_ns_ = now.newest_ns;  // even if hidden by overload: the clock may have jumped back
  if (!is_overloaded()) ReportState(now);
}

void LiveEventReporter::ReportSensor(std::size_t index, SensorState state, TimeNs newest_ns) {
  Sensor& sensor = sensors_[index];
  if (sensor.state == state) return;
  sensor.state = state;
  output_.ReportSensor(newest_ns, sensor.name, state, sensor.clock);
  if (state != SensorState::kBlinded) return;
  NoteIncident(
      sensor.name + ": blinded: it does not see what it should (fog, snow, a covered window?)",
      &sensor.num_blinded);
}

void LiveEventReporter::ReportReturns(std::size_t sensor, TimeNs stamp_ns,
                                      const std::vector<Eigen::Vector3f>& points_m,
                                      std::size_t max_returns, TimeNs newest_ns) {
  if (!sensors_[sensor].view.IsDue(stamp_ns)) return;
  output_.ReportReturns(newest_ns, sensors_[sensor].name, stamp_ns,
                        TextOfReturns(points_m, ThinnedReturns(points_m, max_returns)));
}

void LiveEventReporter::ReportClock(std::size_t index, SyncState clock, TimeNs newest_ns) {
  Sensor& sensor = sensors_[index];
  if (std::exchange(sensor.clock, clock) == clock) return;
  if (sensor.state) output_.ReportSensor(newest_ns, sensor.name, *sensor.state, clock);
  if (clock != SyncState::kLost) return;
  NoteIncident(sensor.name +
                   ": has lost its time synchronisation (PTP, GPS), its frames go on by the clock "
                   "of this computer",
               &sensor.num_lost);
}

void LiveEventReporter::ReportPace(std::uint64_t one_in, std::uint64_t left_out,
                                   const LiveProgress& now) {
  const bool was_overloaded = is_overloaded();
  if (std::exchange(one_in_, one_in) == one_in) return;
  Note(is_overloaded() ? "overloaded: one frame in " + std::to_string(one_in) + " is worked off"
                       : "no more overloaded, left out: " + Count(left_out, "frame"));
  if (was_overloaded != is_overloaded()) ReportState(now);
}

// Reported only once, because for readers a warm-up ends all earlier tracks.
void LiveEventReporter::SendHeartbeat(const LiveProgress& now) {
  if (state_ == LiveState::kRunning && now.newest_ns - state_reported_ns_ >= kStateIntervalNs) {
    ReportState(now);
  }
}

void LiveEventReporter::ReportState(const LiveProgress& now) {
  state_reported_ns_ = now.newest_ns;
  output_.ReportState(now.newest_ns, state(), now.frames, now.lost_frames);
  service_.ReportStatus(LiveStateName(state()));
}

}  // namespace unlidar
