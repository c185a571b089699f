// The program: arguments in, files out, every error one line and an exit code.
#include <malloc.h>

#include <csignal>
#include <cstdlib>
#include <exception>
#include <new>
#include <optional>
#include <string>

#include "app/arguments.hpp"
#include "app/output_files.hpp"
#include "app/track_drones.hpp"
#include "unlidar/error.hpp"
#ifdef UNLIDAR_WITH_PCL
#include "pcl/pcl_clustering.hpp"
#endif

namespace unlidar {
namespace {

// Called where an exception cannot be passed on: destructors of some libraries allocate.
[[noreturn]] void Terminate() {
  TemporaryPath::RemoveAll();
  const char* text = "unlidar_track: error: internal: an exception without a handler\n";
  try {
    if (const std::exception_ptr error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::bad_alloc&) {
    text = "unlidar_track: error: out of memory\n";
  } catch (...) {  // NOLINT(bugprone-empty-catch): the text says it
  }
  WriteToStderr(text);
  std::_Exit(static_cast<int>(ExitCode::kInternal));
}

int Fail(ExitCode code, const std::string& text) {
  PrintNote("error: " + text);
  return static_cast<int>(code);
}

}  // namespace

int Run(int argc, char** argv) {
  try {
    Arguments arguments;
    if (const std::optional<std::string> text = ParseArguments(argc, argv, &arguments)) {
      WriteToStdout(*text);
    } else {
      TrackDrones(arguments);
    }
    return static_cast<int>(ExitCode::kDone);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Error& error) {
    return Fail(error.code(), error.what());
  } catch (const std::exception& error) {
    return Fail(ExitCode::kInternal, std::string("internal: ") + error.what());
  }
}

int Main(int argc, char** argv) {
  // A reader that has gone and a limit of file sizes are errors of writing like others.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  std::set_terminate(Terminate);
  // Tables that grow are copied; what they leave is otherwise kept, in holes of the heap.
  constexpr int kLargeBytes = 1 << 20;
  mallopt(M_MMAP_THRESHOLD, kLargeBytes);
#ifdef UNLIDAR_WITH_PCL
  UsePclClustering();
#endif
  try {
    return Run(argc, argv);
  } catch (const std::bad_alloc&) {
    WriteToStderr("unlidar_track: error: out of memory\n");  // which takes none
    return static_cast<int>(ExitCode::kInternal);
  }
}

}  // namespace unlidar

int main(int argc, char** argv) { return unlidar::Main(argc, argv); }
