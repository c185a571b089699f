#include "app/output_files.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <new>
#include <optional>
#include <random>
#include <utility>

#include "base/format.hpp"
#include "io/descriptor.hpp"
#include "unlidar/error.hpp"

namespace unlidar {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBlockBytes = std::size_t{1} << 16;
constexpr std::size_t kMaxTextBytes = 10'000;  // room for two paths of maximum length and a message
constexpr int kMaxLinks = 40;                  // as Linux
constexpr mode_t kRights = 0777;
constexpr mode_t kGroupRights = 0070;
constexpr uid_t kNoChange = static_cast<uid_t>(-1);
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
  return (fs::path(path).parent_path() / name).string();
}

[[noreturn]] void FailWith(int error, const std::string& path) {
  if (error == ENOMEM) throw std::bad_alloc();  // of the library, which reports it like this
  FailToWrite(path, std::strerror(error));
}

// Hands everything over in blocks.
void WriteContent(int fd, const OutputFile& file) {
  std::string block;
  file.write([&](std::string_view bytes) {
    block += bytes;
    if (block.size() < kBlockBytes) return;
    WriteAll(fd, block, file.path);
    block.clear();
  });
  WriteAll(fd, block, file.path);
}

void WriteInPlace(const OutputFile& file) {
  Descriptor target(Uninterrupted([&] { return ::open(file.path.c_str(), O_WRONLY | O_CLOEXEC); }));
  if (!target.is_open()) FailWith(errno, file.path);
  WriteContent(target.get(), file);
  if (!target.Close()) FailWith(errno, file.path);
}

// Returns the status behind links; none if nothing is there. Throws on any other error: a device
// must not be mistaken for a file that may be replaced.
std::optional<struct stat> Status(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) == 0) return status;
  if (errno != ENOENT) FailWith(errno, path);
  return std::nullopt;
}

// Returns the path that a write would replace, with all links followed, also dangling ones.
fs::path Resolved(const std::string& path, std::error_code& error) {
  fs::path resolved = fs::weakly_canonical(fs::absolute(path, error), error);
  for (int links = 0; !error; ++links) {
    std::error_code status_error;  // set for what is not there, too
    const fs::file_status status = fs::symlink_status(resolved, status_error);
    if (status.type() == fs::file_type::none) error = status_error;
    if (status.type() != fs::file_type::symlink) break;
    if (links == kMaxLinks) error = std::make_error_code(std::errc::too_many_symbolic_link_levels);
    if (!error) resolved = resolved.parent_path() / fs::read_symlink(resolved, error);
    if (!error) resolved = fs::weakly_canonical(resolved, error);
  }
  return resolved;
}

// The same as a text. To take a link for a file would replace it.
std::string ResolvedText(const std::string& path) {
  std::error_code error;
  const fs::path resolved = Resolved(path, error);
  if (error) FailWith(error.value(), path);
  return resolved.string();
}

// A file beside the target that takes its place on Commit, else vanishes.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& path)
      : path_(path),
        target_(ResolvedText(path)),
        old_(Status(target_)),
        temporary_(target_),
        fd_(Create()) {
    if (old_) CopyPermissions();
  }

  void Write(const OutputFile& file) {
    WriteContent(fd_.get(), file);
    // A power cut after the rename must not leave an empty file in the old one's place.
    const int synced = Uninterrupted([&] { return ::fsync(fd_.get()); });
    if ((synced != 0 && errno != EINVAL) || !fd_.Close()) FailWith(errno, path_);
  }

  void Commit() {
    if (std::rename(temporary_.c_str(), target_.c_str()) != 0) FailWith(errno, path_);
  }

 private:
  int Create() const {
    const mode_t mode = old_ ? S_IRUSR | S_IWUSR : 0666;  // the umask takes from the latter
    const int fd = Uninterrupted(
        [&] { return ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode); });
    if (fd < 0) FailWith(errno, path_);
    return fd;
  }

  void CopyPermissions() const {
    mode_t mode = old_->st_mode & kRights;
    // Only root may give a file away, others at least to a group of theirs. In a group that is not
    // the old one, nobody gains a right.
    const bool has_group = ::fchown(fd_.get(), old_->st_uid, old_->st_gid) == 0 ||
                           ::fchown(fd_.get(), kNoChange, old_->st_gid) == 0;
    if (!has_group) mode = (mode & ~kGroupRights) | (mode & (mode << 3) & kGroupRights);
    if (::fchmod(fd_.get(), mode) != 0) FailWith(errno, path_);
  }

  std::string path_;
  std::string target_;
  std::optional<struct stat> old_;  // of the target, if there is one
  TemporaryPath temporary_;
  Descriptor fd_;
};

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

ContentWriter Content(std::string bytes) {
  return [bytes = std::move(bytes)](const Sink& sink) { sink(bytes); };
}

std::string ResolvedPath(const std::string& path) {
  std::error_code error;
  const fs::path resolved = Resolved(path, error);
  return error ? path : resolved.string();
}

bool IsSpecialFile(const std::string& path) {
  const auto status = Status(path);
  return status && !S_ISREG(status->st_mode) && !S_ISDIR(status->st_mode);
}

void CheckWritable(const std::string& path) {
  const auto status = Status(path);
  if (!fs::path(path).has_filename() || (status && S_ISDIR(status->st_mode))) {
    FailToWrite(path, "it names a directory, expected a file");
  }
  if (IsSpecialFile(path)) {
    if (::access(path.c_str(), W_OK) != 0) FailWith(errno, path);
    return;
  }
  std::error_code error;
  const fs::path directory = fs::path(ResolvedText(path)).parent_path();
  const bool is_directory = fs::is_directory(directory, error);
  if (error && error != std::errc::no_such_file_or_directory) {
    FailWith(error.value(), path);
  }
  if (!is_directory) {
    FailToWrite(path, "'" + directory.string() + "' is no directory, expected an existing one");
  }
  const TemporaryFile probe(path);
}

void WriteFiles(const std::vector<OutputFile>& files) {
  std::deque<TemporaryFile> temporaries;
  for (const OutputFile& file : files) {
    if (IsSpecialFile(file.path)) continue;
    temporaries.emplace_back(file.path).Write(file);
  }
  for (const OutputFile& file : files) {
    if (IsSpecialFile(file.path)) WriteInPlace(file);
  }
  for (TemporaryFile& temporary : temporaries) temporary.Commit();
}

void FailToWrite(const std::string& path, const std::string& reason) {
  throw OutputError(path + ": cannot be written: " + reason);
}

void FailToWrite(const std::string& path) { FailToWrite(path, std::strerror(errno)); }

void WriteAll(int fd, std::string_view bytes, const std::string& path) {
  while (!bytes.empty()) {
    const ssize_t written = Uninterrupted([&] { return ::write(fd, bytes.data(), bytes.size()); });
    if (written < 0) FailToWrite(path);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void WriteToStdout(std::string_view text) { WriteAll(STDOUT_FILENO, text, "stdout"); }

void WriteToStderr(std::string_view text) {
  try {
    WriteAll(STDERR_FILENO, text, "stderr");
  } catch (const OutputError&) {  // NOLINT(bugprone-empty-catch): see the declaration
  }
}

void PrintResult(const std::string& text) { WriteToStdout(Shortened(text, kMaxTextBytes) + "\n"); }

void PrintNote(const std::string& text) {
  WriteToStderr("unlidar_track: " + Shortened(text, kMaxTextBytes) + "\n");
}

}  // namespace unlidar
