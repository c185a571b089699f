#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <string>
#include <thread>
#include <vector>

#include "app/service.hpp"
#include "io/descriptor.hpp"
#include "tests/temporary_folder.hpp"

namespace unlidar {
namespace {

using ::unlidar::testing::TemporaryFolder;
using Messages = std::vector<std::string>;

// Stands for systemd: a socket that takes messages, and the environment that names it.
class Manager {
 public:
  // `name`: as in $NOTIFY_SOCKET.
  explicit Manager(const std::string& name)
      : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::copy(name.begin(), name.end(), address.sun_path);
    if (name.front() == '@') address.sun_path[0] = '\0';
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    EXPECT_EQ(::bind(socket_.get(), reinterpret_cast<const sockaddr*>(&address), length), 0);
    ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }
  ~Manager() {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
  }
  Manager(const Manager&) = delete;
  Manager& operator=(const Manager&) = delete;

  Messages Heard() {
    Messages heard;
    std::array<char, 256> text{};
    ssize_t length = 0;
    while ((length = ::recv(socket_.get(), text.data(), text.size(), 0)) >= 0) {
      heard.emplace_back(text.data(), static_cast<std::size_t>(length));
    }
    return heard;
  }

 private:
  Descriptor socket_;
};

TEST(ServiceNotifier, SaysOnceThatItHasStartedWhatItDoesAndThatItEnds) {
  const TemporaryFolder folder;
  Manager manager(folder / "notify");
  ServiceNotifier service;
  EXPECT_EQ(manager.Heard(), Messages());
  service.SendHeartbeat();
  service.SendHeartbeat();
  service.ReportStatus("running");
  service.ReportStopping();
  EXPECT_EQ(manager.Heard(), (Messages{"READY=1", "STATUS=running", "STOPPING=1"}));
}

TEST(ServiceNotifier, ReachesASocketOfTheAbstractNamespace) {
  Manager manager("@unlidar-test-" + std::to_string(::getpid()));
  ServiceNotifier().SendHeartbeat();
  EXPECT_EQ(manager.Heard(), Messages{"READY=1"});
}

TEST(ServiceNotifier, FeedsTheWatchdogWhileTheLoopComesRoundAndNotMoreOftenThanItNeeds) {
  const TemporaryFolder folder;
  Manager manager(folder / "notify");
  ::setenv("WATCHDOG_USEC", "200000", 1);
  ServiceNotifier service;
  service.SendHeartbeat();
  EXPECT_EQ(manager.Heard(), Messages{"READY=1"});
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  for (int i = 0; i < 1000; ++i) service.SendHeartbeat();
  const Messages fed = manager.Heard();
  ASSERT_FALSE(fed.empty());
  EXPECT_EQ(fed.front(), "WATCHDOG=1");
  EXPECT_LT(fed.size(), 10U);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(manager.Heard(), Messages()) << "fed without the loop";
}

TEST(ServiceNotifier, LeavesTheWatchdogOfAnotherProcessAlone) {
  const TemporaryFolder folder;
  Manager manager(folder / "notify");
  ::setenv("WATCHDOG_USEC", "4", 1);
  ::setenv("WATCHDOG_PID", "1", 1);
  ServiceNotifier service;
  for (int i = 0; i < 10; ++i) service.SendHeartbeat();
  EXPECT_EQ(manager.Heard(), Messages{"READY=1"});
}

TEST(ServiceNotifier, SaysItHasStartedAsSoonAsItIsHeard) {
  const TemporaryFolder folder;
  ::setenv("NOTIFY_SOCKET", (folder / "notify").c_str(), 1);
  ServiceNotifier service;
  service.SendHeartbeat();  // nobody is there
  Manager manager(folder / "notify");
  service.SendHeartbeat();
  EXPECT_EQ(manager.Heard(), Messages{"READY=1"});
}

TEST(ServiceNotifier, NeedsNoManager) {
  for (const std::string& name : {std::string(), std::string("@"), std::string("no/path"),
                                  std::string(300, '/'), std::string("/absent/socket")}) {
    ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
    ServiceNotifier service;
    service.SendHeartbeat();
    service.ReportStopping();
  }
  ::unsetenv("NOTIFY_SOCKET");
  ServiceNotifier().SendHeartbeat();
}

}  // namespace
}  // namespace unlidar
