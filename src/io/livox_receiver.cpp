#include "io/livox_receiver.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <vector>

#include "base/format.hpp"
#include "io/input_limits.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

// Polling interval while the queue is full.
constexpr int kFullPauseMs = 2;

// Packets arrive by the thousands per second. Taking them in batches wakes the processor less
// often; the socket buffer holds many times this interval.
constexpr int kGatherMs = 2;

// Requested socket buffer; the system may grant less.
constexpr int kSocketBytes = 1 << 23;

// Packets per batch, between checks for the end and after it: more than the socket buffer holds,
// but bounded, since a flood never ends.
constexpr int kMaxAtOnce = 1 << 12;

std::size_t SizeOf(const Datagram& datagram) { return sizeof(datagram) + datagram.payload.size(); }

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

std::string AddressText(std::uint32_t address) {
  const in_addr value{htonl(address)};
  std::array<char, INET_ADDRSTRLEN> text{};
  ::inet_ntop(AF_INET, &value, text.data(), text.size());
  return text.data();
}

LivoxEndpoint ParseLivoxEndpoint(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  in_addr address{};
  if (colon != std::string::npos &&
      ::inet_pton(AF_INET, text.substr(0, colon).c_str(), &address) == 1) {
    const auto port = ParseNumber<std::uint16_t>(std::string_view{text}.substr(colon + 1));
    if (port) return {ntohl(address.s_addr), *port};
  }
  throw UsageError("--livox " + Shortened(text) +
                   ": expected an IPv4 address of this computer and a port, as in "
                   "192.168.1.5:56301 or 0.0.0.0:56301");
}

LivoxReceiver::LivoxReceiver(LivoxEndpoint endpoint)
    : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)),
      waiting_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      ending_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      endpoint_(endpoint) {
  const auto check = [&](bool is_fine) {
    if (!is_fine) throw InputError(name() + ": cannot be listened on: " + std::strerror(errno));
  };
  check(socket_.is_open() && waiting_.is_open() && ending_.is_open());
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_RCVBUF, &kSocketBytes, sizeof(kSocketBytes));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint_.address);
  address.sin_port = htons(endpoint_.port);
  socklen_t size = sizeof(address);
  auto* const any = reinterpret_cast<sockaddr*>(&address);
  check(::bind(socket_.get(), any, size) == 0 && ::getsockname(socket_.get(), any, &size) == 0);
  endpoint_.port = ntohs(address.sin_port);
  thread_ = std::thread([this] { Receive(); });
}

std::optional<Datagram> LivoxReceiver::Next() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (datagrams_.empty()) return std::nullopt;
  Datagram datagram = std::move(datagrams_.front());
  datagrams_.pop_front();
  bytes_ -= SizeOf(datagram);
  if (datagrams_.empty()) {
    std::uint64_t count = 0;
    (void)!::read(waiting_.get(), &count, sizeof(count));
  }
  return datagram;
}

void LivoxReceiver::Stop() {
  if (!thread_.joinable()) return;
  const std::uint64_t one = 1;
  (void)!::write(ending_.get(), &one, sizeof(one));
  thread_.join();
}

bool LivoxReceiver::IsFull() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return bytes_ > kMaxWaitingPacketBytes;
}

void LivoxReceiver::Receive() {
  std::array<pollfd, 2> fds = {{{ending_.get(), POLLIN, 0}, {socket_.get(), POLLIN, 0}}};
  while (fds[0].revents == 0) {
    const bool is_full = IsFull();
    ::poll(fds.data(), is_full ? 1 : fds.size(), is_full ? kFullPauseMs : -1);
    if (!is_full || fds[0].revents != 0) TakeAll();
    pollfd ending = fds[0];
    ::poll(&ending, 1, kGatherMs);
  }
}

// Network errors are ignored: the network may recover.
void LivoxReceiver::TakeAll() {
  std::array<char, kMaxDatagramBytes> bytes{};
  std::vector<Datagram> taken;
  for (int i = 0; i < kMaxAtOnce; ++i) {
    sockaddr_in sender{};
    socklen_t size = sizeof(sender);
    const ssize_t got = ::recvfrom(socket_.get(), bytes.data(), bytes.size(), MSG_TRUNC,
                                   reinterpret_cast<sockaddr*>(&sender), &size);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) break;
    const auto length = std::min(static_cast<std::size_t>(got), bytes.size());
    Datagram datagram;
    datagram.source = ntohl(sender.sin_addr.s_addr);
    datagram.source_port = ntohs(sender.sin_port);
    datagram.received_ns = NsSinceEpoch(std::chrono::system_clock::now());
    datagram.arrived = Datagram::Clock::now();
    datagram.sent_bytes = static_cast<std::size_t>(got);
    datagram.payload.assign(bytes.data(), length);
    taken.push_back(std::move(datagram));
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (datagrams_.empty() && !taken.empty()) {
    const std::uint64_t one = 1;
    (void)!::write(waiting_.get(), &one, sizeof(one));
  }
  for (Datagram& datagram : taken) {
    bytes_ += SizeOf(datagram);
    datagrams_.push_back(std::move(datagram));
  }
}

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

std::optional<std::uint32_t> LivoxLidars::FreeSlot() {
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
