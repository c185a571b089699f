#include "app/newest_lines.hpp"

#include <fcntl.h>

#include <cstdio>
#include <utility>

#include "app/temporary_path.hpp"
#include "unlidar/error.hpp"

namespace unlidar {

NewestLines::NewestLines(const std::string& path, NoteCallback note)
    : path_(ResolvedPath(path)), note_(std::move(note)) {
  BeginAnew();
}

void NewestLines::Append(std::string_view line) {
  try {
    if (!file_.is_open() || bytes_ + line.size() > kMaxBytes) BeginAnew();
    bytes_ += line.size();
    WriteAll(file_.get(), line, path_);
    has_failed_ = false;
  } catch (const OutputError& error) {
    file_.Close();  // its last line may be torn
    if (!std::exchange(has_failed_, true)) note_(error.what());
  }
}

void NewestLines::BeginAnew() {
  const TemporaryPath temporary(path_);
  Descriptor file(Uninterrupted(
      [&] { return ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666); }));
  if (!file.is_open() || std::rename(temporary.c_str(), path_.c_str()) != 0) {
    FailToWrite(path_);
  }
  file_ = std::move(file);
  bytes_ = 0;
}

}  // namespace unlidar
