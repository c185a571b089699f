// Test-only, for LD_PRELOAD: makes the n-th call of one function fail, from the begin of main on.
//
//   FAULT_CALL    open read write close fsync rename unlink stat readdir ... or malloc
//   FAULT_NTH     which call of it, from 1
//   FAULT_ERRNO   with this error
//   FAULT_SIGNAL  or does not let it fail, but this signal come first
//   FAULT_SHORT   or, not 0, lets it do half of the bytes
//   FAULT_MARK    a file that is made when it happens: without it the run made fewer calls
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdlib>
#include <cstring>

// dlsym allocates: what allocates finds the real functions by other names.
// NOLINTBEGIN(clang-diagnostic-reserved-identifier): of glibc
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
}
// NOLINTEND(clang-diagnostic-reserved-identifier)

namespace {

bool active = false;
const char* call = "";
long nth = 0;
long count = 0;

long Setting(const char* name) {
  const char* const text = std::getenv(name);
  return text != nullptr ? std::atol(text) : 0;
}

// True if the call must fail, with errno set.
bool Fails(const char* name) {
  if (!active || std::strcmp(name, call) != 0 || ++count != nth) return false;
  active = false;
  if (const char* const mark = std::getenv("FAULT_MARK")) {
    syscall(SYS_close, syscall(SYS_openat, AT_FDCWD, mark, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  }
  if (const long signal = Setting("FAULT_SIGNAL")) {
    std::raise(static_cast<int>(signal));
    return false;
  }
  errno = static_cast<int>(Setting("FAULT_ERRNO"));
  return true;
}

template <class Function>
Function* Next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

// read and write: halved where that is asked for.
template <class Bytes>
ssize_t Transfer(const char* name, int fd, Bytes bytes, std::size_t size) {
  if (Fails(name)) {
    if (Setting("FAULT_SHORT") == 0) return -1;
    size = (size + 1) / 2;
  }
  return Next<ssize_t(int, Bytes, std::size_t)>(name)(fd, bytes, size);
}

int (*real_main)(int, char**, char**) = nullptr;

int MainWithFaults(int argc, char** argv, char** environment) {
  if (const char* const name = std::getenv("FAULT_CALL")) call = name;
  nth = Setting("FAULT_NTH");
  active = true;
  const int result = real_main(argc, argv, environment);
  active = false;
  return result;
}

}  // namespace

extern "C" {

// NOLINTNEXTLINE(clang-diagnostic-reserved-identifier): of glibc
int __libc_start_main(int (*main)(int, char**, char**), int argc, char** argv, void (*init)(),
                      void (*fini)(), void (*loader_fini)(), void* stack_end) {
  real_main = main;
  return Next<decltype(__libc_start_main)>("__libc_start_main")(MainWithFaults, argc, argv, init,
                                                                fini, loader_fini, stack_end);
}

int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const unsigned mode = (flags & O_CREAT) != 0 ? va_arg(rest, unsigned) : 0;
  va_end(rest);
  return Fails("open") ? -1 : Next<int(const char*, int, ...)>("open")(path, flags, mode);
}

// Opens folders only, in libstdc++.
ssize_t read(int fd, void* bytes, std::size_t size) { return Transfer("read", fd, bytes, size); }
ssize_t write(int fd, const void* bytes, std::size_t size) {
  return Transfer("write", fd, bytes, size);
}

int close(int fd) {
  const bool fails = Fails("close");
  const int error = errno;
  const int result = Next<int(int)>("close")(fd);
  if (fails) errno = error;
  return fails ? -1 : result;
}

int fsync(int fd) { return Fails("fsync") ? -1 : Next<int(int)>("fsync")(fd); }
int rename(const char* from, const char* to) noexcept {
  return Fails("rename") ? -1 : Next<int(const char*, const char*)>("rename")(from, to);
}
int unlink(const char* path) {
  return Fails("unlink") ? -1 : Next<int(const char*)>("unlink")(path);
}
int access(const char* path, int mode) {
  return Fails("access") ? -1 : Next<int(const char*, int)>("access")(path, mode);
}
int fchmod(int fd, unsigned mode) {
  return Fails("fchmod") ? -1 : Next<int(int, unsigned)>("fchmod")(fd, mode);
}
int fchown(int fd, unsigned user, unsigned group) {
  return Fails("fchown") ? -1 : Next<int(int, unsigned, unsigned)>("fchown")(fd, user, group);
}

// There is a struct of that name.
int StatWithFaults(const char* path, void* to) __asm__("stat");
int StatWithFaults(const char* path, void* to) {
  return Fails("stat") ? -1 : Next<int(const char*, void*)>("stat")(path, to);
}
int lstat(const char* path, void* to) {
  return Fails("lstat") ? -1 : Next<int(const char*, void*)>("lstat")(path, to);
}
int fstat(int fd, void* to) { return Fails("fstat") ? -1 : Next<int(int, void*)>("fstat")(fd, to); }

char* getcwd(char* path, std::size_t size) {
  return Fails("getcwd") ? nullptr : Next<char*(char*, std::size_t)>("getcwd")(path, size);
}
char* realpath(const char* path, char* to) noexcept {
  return Fails("realpath") ? nullptr : Next<char*(const char*, char*)>("realpath")(path, to);
}
ssize_t readlink(const char* path, char* to, std::size_t size) {
  return Fails("readlink")
             ? -1
             : Next<ssize_t(const char*, char*, std::size_t)>("readlink")(path, to, size);
}

void* opendir(const char* path) {
  return Fails("opendir") ? nullptr : Next<void*(const char*)>("opendir")(path);
}
void* readdir(void* folder) {
  return Fails("readdir") ? nullptr : Next<void*(void*)>("readdir")(folder);
}

void* malloc(std::size_t size) noexcept { return Fails("malloc") ? nullptr : __libc_malloc(size); }
void* calloc(std::size_t number, std::size_t size) noexcept {
  return Fails("malloc") ? nullptr : __libc_calloc(number, size);
}
void* realloc(void* memory, std::size_t size) noexcept {
  return Fails("malloc") ? nullptr : __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  return Fails("malloc") ? nullptr : __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) noexcept {
  if (Fails("malloc")) return ENOMEM;
  *memory = __libc_memalign(alignment, size);
  return *memory != nullptr ? 0 : ENOMEM;
}

}  // extern "C"
