#include "io/livox_lidars.hpp"

#include <algorithm>
#include <string_view>
#include <utility>
#include <vector>

#include "base/format.hpp"
#include "io/input_limits.hpp"

namespace unlidar {
namespace {

std::string NameOf(std::uint32_t source, const LivoxPacket& packet) {
  std::string name = AddressText(source);
  std::replace(name.begin(), name.end(), '.', '-');
  if (packet.slot > 1 || packet.lidar > 1) {
    name += "-" + std::to_string(packet.slot) + "-" + std::to_string(packet.lidar);
  }
  return name;
}

// True for the four numbers of an address and, of a LiDAR at a hub, two more, as NameOf() writes
// them.
bool IsLivoxName(const std::string& name) {
  const std::vector<std::string_view> numbers = Split(name, '-');
  const auto is_number = [](std::string_view text) {
    const auto value = ParseNumber<std::uint8_t>(text);
    return value && std::to_string(*value) == text;
  };
  return (numbers.size() == 4 || numbers.size() == 6) &&
         std::all_of(numbers.begin(), numbers.end(), is_number);
}

}  // namespace

std::set<std::string> LivoxNames(const std::map<std::string, SensorConfig>& sensors) {
  std::set<std::string> names;
  for (const auto& [name, sensor] : sensors) {
    if (IsLivoxName(name)) names.insert(name);
  }
  return names;
}

LivoxLidar* LivoxLidars::Take(const Datagram& datagram) {
  const LivoxPacket packet = ParseLivoxPacket(datagram.payload);
  if (packet.rays == 0) return nullptr;
  LivoxLidar& lidar = LidarOf(datagram, packet);
  lidar.arrived = datagram.arrived;
  lidar.cutter.Add(packet, datagram.arrival());
  BoundUnfinished();
  return &lidar;
}

LivoxLidar& LivoxLidars::LidarOf(const Datagram& datagram, const LivoxPacket& packet) {
  const Identity identity(datagram.source, packet.slot, packet.lidar);
  const auto known = lidars_.find(identity);
  if (known != lidars_.end()) return known->second;
  std::string name = NameOf(datagram.source, packet);
  if (!allowed_.empty() && allowed_.count(name) == 0) {
    throw PacketError("is of " + name + ", expected one that sensors names, as " +
                      *allowed_.begin());
  }
  if (lidars_.size() >= kMaxSensors) MakeRoom(datagram.arrived);
  return lidars_.emplace(identity, LivoxLidar(std::move(name), frame_ns_)).first->second;
}

// LiDARs without a whole frame are removed first, so that a flood of new senders displaces no
// established one.
void LivoxLidars::MakeRoom(Clock::time_point now) {
  const auto is_before = [](const auto& a, const auto& b) {
    return std::make_pair(a.second.sensor.has_value(), a.second.arrived) <
           std::make_pair(b.second.sensor.has_value(), b.second.arrived);
  };
  const auto last = std::min_element(lidars_.begin(), lidars_.end(), is_before);
  if (last->second.sensor && now - last->second.arrived <= silent_) {
    throw PacketError("is of one more sensor, expected at most " + std::to_string(kMaxSensors));
  }
  if (last->second.sensor) free_slots_.insert(*last->second.sensor);
  forgotten_packets_ += last->second.cutter.counts().packets();
  lidars_.erase(last);
}

std::optional<std::size_t> LivoxLidars::FreeSlot() {
  if (free_slots_.empty()) return std::nullopt;
  return free_slots_.extract(free_slots_.begin()).value();
}

std::size_t LivoxLidars::unfinished_bytes() const {
  std::size_t bytes = 0;
  for (const auto& [identity, lidar] : lidars_) bytes += lidar.cutter.unfinished_bytes();
  return bytes;
}

void LivoxLidars::BoundUnfinished() {
  if (unfinished_bytes() <= kMaxUnfinishedBytes) return;
  const auto has_less = [](const auto& a, const auto& b) {
    return a.second.cutter.unfinished_bytes() < b.second.cutter.unfinished_bytes();
  };
  std::max_element(lidars_.begin(), lidars_.end(), has_less)->second.cutter.DropUnfinished();
}

}  // namespace unlidar
