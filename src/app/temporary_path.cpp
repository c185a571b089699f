#include "app/temporary_path.hpp"

#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <random>

#include "io/descriptor.hpp"

namespace unlidar {
namespace {

constexpr int kDeadlySignals[] = {SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU};

// A list that is consistent at every instant: a signal may arrive between any two instructions.
std::atomic<TemporaryPath*> first_path = nullptr;

// Gives the signals that mean `from` the meaning `to`.
void Exchange(void (*from)(int), void (*to)(int)) {
  struct sigaction action {};
  action.sa_handler = to;
  for (const int signal : kDeadlySignals) {
    struct sigaction old {};
    if (::sigaction(signal, nullptr, &old) == 0 && old.sa_handler == from) {
      ::sigaction(signal, &action, nullptr);
    }
  }
}

// Calls only what a signal handler may.
void RemoveAllAndDie(int signal) {
  TemporaryPath::RemoveAll();
  ::signal(signal, SIG_DFL);
  ::raise(signal);  // it is held back until the end of this function
}

// A counter or the process' number would come again after a restart, in a container the same.
std::string RandomPathBeside(const std::string& path) {
  std::random_device random;
  char name[48];
  std::snprintf(name, sizeof(name), ".unlidar_track-%08x%08x.part", random(), random());
  return (std::filesystem::path(path).parent_path() / name).string();
}

}  // namespace

TemporaryPath::TemporaryPath(const std::string& beside)
    : path_(RandomPathBeside(beside)), next_(first_path) {
  if (next_ == nullptr) Exchange(SIG_DFL, RemoveAllAndDie);
  first_path = this;
}

TemporaryPath::~TemporaryPath() {
  Uninterrupted([&] { return ::unlink(path_.c_str()); });
  if (first_path == this) {
    first_path = next_;
  } else {
    TemporaryPath* before = first_path;
    while (before->next_ != this) before = before->next_;
    before->next_ = next_;
  }
  if (first_path == nullptr) Exchange(RemoveAllAndDie, SIG_DFL);
}

void TemporaryPath::RemoveAll() {
  for (TemporaryPath* path = first_path; path != nullptr; path = path->next_) {
    ::unlink(path->path_.c_str());
  }
}

}  // namespace unlidar
