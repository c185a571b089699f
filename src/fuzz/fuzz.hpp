// What the fuzzers share: laws that end a run where they do not hold, files without a disk.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "unlidar/error.hpp"

namespace unlidar::fuzz {

inline std::string_view Text(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

// Ends the run, with the input kept by libFuzzer, unless the law holds.
inline void Require(bool holds, const char* law) {
  if (holds) return;
  std::fprintf(stderr, "BROKEN LAW: %s\n", law);
  std::abort();
}

// What a message owes its reader, whatever the input.
inline void RequireGoodMessage(const Error& error) {
  const std::string_view message = error.what();
  Require(!message.empty(), "an error says what is wrong");
  Require(message.find('\n') == std::string_view::npos, "an error is one line");
  Require(message.size() <= 1000, "an error can be read");
}

// Runs `step`; the only error that may come out of it is one for the user. True if none did.
template <typename Step>
bool Succeeds(const Step& step) {
  try {
    step();
    return true;
  } catch (const Error& error) {
    RequireGoodMessage(error);
  }
  return false;
}

// Text under a path, in memory.
class MemoryFile {
 public:
  explicit MemoryFile(std::string_view text) : descriptor_(::memfd_create("fuzz", MFD_CLOEXEC)) {
    Require(descriptor_ >= 0 &&
                ::write(descriptor_, text.data(), text.size()) == static_cast<ssize_t>(text.size()),
            "there is room for a file");
  }
  ~MemoryFile() { ::close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

// A folder in memory where the system has one, gone with the program.
class ScratchFolder {
 public:
  ScratchFolder() {
    const std::filesystem::path memory = "/dev/shm";
    const auto above =
        std::filesystem::exists(memory) ? memory : std::filesystem::temp_directory_path();
    std::string pattern = (above / "unlidar_fuzz_XXXXXX").string();
    Require(::mkdtemp(pattern.data()) != nullptr, "there is room for a folder");
    path_ = pattern;
  }
  ~ScratchFolder() { std::filesystem::remove_all(path_); }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  // Makes and empties a folder in it.
  std::string Empty(const std::string& name) const {
    const std::filesystem::path folder = path_ / name;
    std::filesystem::remove_all(folder);
    std::filesystem::create_directory(folder);
    return folder.string();
  }

 private:
  std::filesystem::path path_;
};

inline void WriteFile(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// Reads an input from its front to its end; behind the end there are zeros.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : bytes_(bytes) {}

  bool empty() const { return bytes_.empty(); }

  std::uint8_t Byte() {
    if (bytes_.empty()) return 0;
    const auto value = static_cast<std::uint8_t>(bytes_.front());
    bytes_.remove_prefix(1);
    return value;
  }

  // In [0, 1].
  double Share() { return Byte() / 255.0; }

  // In [-limit, limit], 0 included.
  double Within(double limit) { return static_cast<std::int8_t>(Byte()) / 128.0 * limit; }

  // All up to a byte of zero, or to the end.
  std::string_view Line() {
    const std::string_view line = bytes_.substr(0, bytes_.find('\0'));
    bytes_.remove_prefix(std::min(line.size() + 1, bytes_.size()));
    return line;
  }

 private:
  std::string_view bytes_;
};

}  // namespace unlidar::fuzz
