#include "unlidar/output_files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <string_view>

#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void Fail(const std::string& path, const std::string& reason) {
  throw OutputError(path + ": cannot be written: " + reason);
}

[[noreturn]] void FailWithErrno(const std::string& path) { Fail(path, std::strerror(errno)); }

// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

void WriteAll(int fd, std::string_view content, const std::string& path) {
  while (!content.empty()) {
    const ssize_t written = ::write(fd, content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) FailWithErrno(path);
    content.remove_prefix(static_cast<std::size_t>(written));
  }
}

void WriteInPlace(const OutputFile& file) {
  const Descriptor target(::open(file.path.c_str(), O_WRONLY | O_CLOEXEC));
  if (target.get() < 0) FailWithErrno(file.path);
  WriteAll(target.get(), file.content, file.path);
}

// A file beside the target that takes its place on Commit, else vanishes.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& path)
      : path_(path),
        target_(ResolvedPath(path)),
        temporary_(target_ + ".part-" + std::to_string(::getpid())),
        fd_(::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666)) {
    if (fd_.get() < 0) FailWithErrno(path_);
  }
  ~TemporaryFile() {
    if (!committed_) ::unlink(temporary_.c_str());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  void Write(std::string_view content) {
    WriteAll(fd_.get(), content, path_);
    // A power cut after the rename must not leave an empty file in the old one's place.
    if (::fsync(fd_.get()) != 0 && errno != EINVAL) FailWithErrno(path_);
  }

  void Commit() {
    if (std::rename(temporary_.c_str(), target_.c_str()) != 0) FailWithErrno(path_);
    committed_ = true;
  }

 private:
  std::string path_;
  std::string target_;
  std::string temporary_;
  Descriptor fd_;
  bool committed_ = false;
};

}  // namespace

std::string ResolvedPath(const std::string& path) {
  std::error_code error;
  const fs::path resolved = fs::weakly_canonical(fs::absolute(path, error), error);
  return error ? path : resolved.string();
}

bool IsSpecialFile(const std::string& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  return fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status);
}

void CheckWritable(const std::string& path) {
  std::error_code error;
  if (!fs::path(path).has_filename() || fs::is_directory(path, error)) {
    Fail(path, "it names a directory, expected a file");
  }
  if (IsSpecialFile(path)) {
    if (::access(path.c_str(), W_OK) != 0) FailWithErrno(path);
    return;
  }
  const fs::path directory = fs::path(ResolvedPath(path)).parent_path();
  if (!fs::is_directory(directory, error)) {
    Fail(path, "'" + directory.string() + "' is no directory, expected an existing one");
  }
  const TemporaryFile probe(path);
}

void WriteFiles(const std::vector<OutputFile>& files) {
  std::deque<TemporaryFile> temporaries;
  for (const OutputFile& file : files) {
    if (IsSpecialFile(file.path)) continue;
    temporaries.emplace_back(file.path).Write(file.content);
  }
  for (const OutputFile& file : files) {
    if (IsSpecialFile(file.path)) WriteInPlace(file);
  }
  for (TemporaryFile& temporary : temporaries) temporary.Commit();
}

}  // namespace unlidar
