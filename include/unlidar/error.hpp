// The error hierarchy; only `main` turns it into an exit code.
#pragma once

#include <stdexcept>
#include <string>

namespace unlidar {

// Exit codes of the program, part of its contract with scripts.
enum class ExitCode : int {
  kDone = 0,  // with or without a drone
  kInternal = 1,
  kUsage = 2,
  kConfig = 3,
  kInput = 4,
  kOutput = 5,
};

// An error that a user can fix. `what()` is one line with the file, the value and the expected one.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

struct UsageError : Error {
  explicit UsageError(const std::string& message) : Error(ExitCode::kUsage, message) {}
};
struct ConfigError : Error {
  explicit ConfigError(const std::string& message) : Error(ExitCode::kConfig, message) {}
};
struct InputError : Error {
  explicit InputError(const std::string& message) : Error(ExitCode::kInput, message) {}
};

// Coordinates that are not in metres. All frames of that sensor are affected, so skipping bad
// frames does not help.
struct UnitError : InputError {
  explicit UnitError(const std::string& message) : InputError(message) {}
};
struct OutputError : Error {
  explicit OutputError(const std::string& message) : Error(ExitCode::kOutput, message) {}
};

}  // namespace unlidar
