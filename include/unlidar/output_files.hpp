// Files that appear whole or not at all.
#pragma once

#include <string>
#include <vector>

namespace unlidar {

struct OutputFile {
  std::string path;
  std::string content;
};

// The path with symbolic links and `.` and `..` resolved: what a write to it would replace.
std::string ResolvedPath(const std::string& path);

// True for a pipe or a device, such as /dev/null or /dev/stdout: written in place.
bool IsSpecialFile(const std::string& path);

// Throws OutputError unless a file can be created beside the target; leaves nothing behind.
void CheckWritable(const std::string& path);

// Writes every file beside its target, then renames all. Throws OutputError if one of them cannot
// be written; then every regular file is as it was before and nothing is left behind.
void WriteFiles(const std::vector<OutputFile>& files);

}  // namespace unlidar
