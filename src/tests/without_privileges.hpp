// Test-only: what the system forbids, as root too.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

namespace unlidar::testing {

// To root nothing is forbidden: acts as nobody while it lives.
class WithoutPrivileges {
 public:
  WithoutPrivileges() {
    if (was_root_ && ::seteuid(kNobody) != 0) ADD_FAILURE() << "still root";
  }
  ~WithoutPrivileges() {
    if (was_root_ && ::seteuid(0) != 0) ADD_FAILURE() << "no longer root";
  }
  WithoutPrivileges(const WithoutPrivileges&) = delete;
  WithoutPrivileges& operator=(const WithoutPrivileges&) = delete;

 private:
  static constexpr uid_t kNobody = 65534;
  bool was_root_ = ::geteuid() == 0;
};

}  // namespace unlidar::testing
