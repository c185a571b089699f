#include "io/livox_receiver.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <string>

#include "io/descriptor.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

constexpr std::uint32_t kLoopback = 0x7f000001;

sockaddr_in Address(const LivoxReceiver& receiver) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(kLoopback);
  const std::string& name = receiver.name();
  address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(name.substr(name.find(':') + 1))));
  return address;
}

class Sender {
 public:
  explicit Sender(const LivoxReceiver& receiver)
      : socket_(::socket(AF_INET, SOCK_DGRAM, 0)), to_(Address(receiver)) {}

  void Send(const std::string& payload) {
    ASSERT_EQ(::sendto(socket_.get(), payload.data(), payload.size(), 0,
                       reinterpret_cast<const sockaddr*>(&to_), sizeof(to_)),
              static_cast<ssize_t>(payload.size()));
  }

 private:
  Descriptor socket_;
  sockaddr_in to_;
};

bool IsReady(int fd, int timeout_ms) {
  pollfd wanted{fd, POLLIN, 0};
  return ::poll(&wanted, 1, timeout_ms) == 1;
}

TEST(LivoxReceiver, GivesPacketsInTheirOrderAndSaysWhenThereAreAny) {
  LivoxReceiver receiver({kLoopback, 0});
  EXPECT_FALSE(IsReady(receiver.fd(), 0));
  EXPECT_FALSE(receiver.Next());
  Sender sender(receiver);
  for (int round = 0; round < 200; ++round) {
    for (int i = 0; i < 20; ++i) sender.Send(std::to_string(20 * round + i));
    for (int i = 0; i < 20; ++i) {
      ASSERT_TRUE(IsReady(receiver.fd(), 60'000));
      const std::optional<Datagram> datagram = receiver.Next();
      ASSERT_TRUE(datagram);
      EXPECT_EQ(datagram->payload, std::to_string(20 * round + i));
      EXPECT_EQ(datagram->source, kLoopback);
    }
    EXPECT_FALSE(IsReady(receiver.fd(), 0));
  }
}

TEST(LivoxReceiver, TakesAllThatHasArrivedWhenItIsStopped) {
  for (int round = 0; round < 50; ++round) {
    LivoxReceiver receiver({kLoopback, 0});
    Sender sender(receiver);
    for (int i = 0; i < 50; ++i) sender.Send("");
    receiver.Stop();
    int count = 0;
    while (receiver.Next()) ++count;
    EXPECT_EQ(count, 50);
  }
}

TEST(LivoxReceiver, KeepsABoundedNumber) {
  LivoxReceiver receiver({kLoopback, 0});
  Sender sender(receiver);
  const std::string payload(2000, 'x');
  for (int i = 0; i < 50'000; ++i) sender.Send(payload);  // 100 MB
  receiver.Stop();
  std::size_t bytes = 0;
  while (const auto datagram = receiver.Next()) bytes += datagram->payload.size();
  EXPECT_LT(bytes, std::size_t{26'000'000});
  EXPECT_GT(bytes, std::size_t{100'000});
}

TEST(LivoxReceiver, RefusesAnAddressOfAnotherComputerAndAPortThatIsTaken) {
  EXPECT_THROW(LivoxReceiver({0xcb007101, 0}), InputError);
  const LivoxReceiver receiver({kLoopback, 0});
  EXPECT_THROW(LivoxReceiver({kLoopback, ntohs(Address(receiver).sin_port)}), InputError);
}

TEST(LivoxEndpoint, IsAnAddressAndAPort) {
  EXPECT_EQ(ParseLivoxEndpoint("192.168.1.5:56301").address, 0xc0a80105U);
  EXPECT_EQ(ParseLivoxEndpoint("0.0.0.0:65535").port, 65535);
  for (const char* text : {"", ":", "56301", "1.2.3.4", "1.2.3.4:", "1.2.3.4:65536", "1.2.3.4:-1",
                           "1.2.3.4:5x", "1.2.3:4", "host:5", "::1:5", " 1.2.3.4:5"}) {
    EXPECT_THROW(ParseLivoxEndpoint(text), UsageError) << text;
  }
}

}  // namespace
}  // namespace unlidar
