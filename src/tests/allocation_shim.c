/* Preloaded into the program: makes each of its allocations fail in turn, in a process of its own,
   reports how each of them ended, and then runs the program as it is.

   Main runs once; at each allocation it forks a child in which that one fails. That takes a fork
   and little more, as most fail at once. From where a file is open for writing, whose position a
   child would share, main runs anew for each allocation.

   ALLOCATIONS_REPORT  file to write, a line for each: exit code, minus the signal that ended it, or
                       -1000 for another output than without a failure; a space; the first line of
                       stderr
   ALLOCATIONS_OUTPUT  file that the program writes, the same in each process
   ALLOCATIONS_STDERR  scratch file */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

typedef int (*Main)(int, char**, char**);
typedef int (*Start)(Main, int, char**, void (*)(void), void (*)(void), void (*)(void), void*);

enum { kReport = 200, kFirstFile = 3, kEndOfFiles = 20 }; /* descriptors */

static Main real_main;
static char expected[1 << 20], output[1 << 20];
static size_t expected_size;

static enum { kOff, kForking, kCounting } mode;
static long fail_at; /* while counting; 0 fails none */
static struct Shared {
  long count;  /* of allocations */
  long forked; /* of those, in how many children one failed */
} * shared;

extern void* __libc_malloc(size_t);
extern void* __libc_calloc(size_t, size_t);
extern void* __libc_realloc(void*, size_t);
extern void* __libc_memalign(size_t, size_t);

static size_t read_file(const char* path, char* text, size_t most) {
  const int file = open(path, O_RDONLY);
  if (file < 0) return 0;
  const ssize_t size = read(file, text, most);
  close(file);
  return size < 0 ? 0 : (size_t)size;
}

static void report(int status) {
  char text[1000];
  int code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  const size_t size = read_file(getenv("ALLOCATIONS_OUTPUT"), output, sizeof(output));
  if (code == 0 && (size != expected_size || memcmp(output, expected, size) != 0)) code = -1000;
  text[read_file(getenv("ALLOCATIONS_STDERR"), text, sizeof(text) - 1)] = 0;
  text[strcspn(text, "\n")] = 0;
  dprintf(kReport, "%d %s\n", code, text);
}

/* A child begins with empty files. */
static pid_t fork_child(void) {
  unlink(getenv("ALLOCATIONS_OUTPUT"));
  const pid_t child = fork();
  if (child == 0) {
    const int file = open(getenv("ALLOCATIONS_STDERR"), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(file, STDERR_FILENO);
    close(file);
  }
  return child;
}

static int wait_for(pid_t child) {
  int status = 0;
  waitpid(child, &status, 0);
  return status;
}

static int is_writing(void) {
  for (int file = kFirstFile; file < kEndOfFiles; ++file) {
    struct stat about;
    if ((fcntl(file, F_GETFL) & O_ACCMODE) == O_RDONLY) continue; /* or not open: all bits set */
    if (fstat(file, &about) == 0 && S_ISREG(about.st_mode)) return 1;
  }
  return 0;
}

static int fails(void) {
  if (mode == kOff) return 0;
  ++shared->count;
  int is_failing = shared->count == fail_at;
  if (mode == kForking) {
    mode = kOff;
    if (is_writing()) {
      mode = kCounting;
      return 0;
    }
    ++shared->forked;
    const pid_t child = fork_child();
    is_failing = child == 0;
    if (!is_failing) {
      report(wait_for(child));
      mode = kForking;
    }
  }
  if (is_failing) errno = ENOMEM;
  return is_failing;
}

void* malloc(size_t size) { return fails() ? NULL : __libc_malloc(size); }
void* calloc(size_t n, size_t size) { return fails() ? NULL : __libc_calloc(n, size); }
void* realloc(void* p, size_t size) { return fails() ? NULL : __libc_realloc(p, size); }
void* memalign(size_t align, size_t size) { return fails() ? NULL : __libc_memalign(align, size); }
void* aligned_alloc(size_t align, size_t size) { return memalign(align, size); }
int posix_memalign(void** p, size_t align, size_t size) {
  *p = memalign(align, size);
  return *p == NULL ? ENOMEM : 0;
}

static int run_all(int argc, char** argv, char** environment) {
  shared = mmap(NULL, sizeof(*shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  const int file = open(getenv("ALLOCATIONS_REPORT"), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (shared == MAP_FAILED || dup2(file, kReport) != kReport) return 1;
  close(file);

  const pid_t plain = fork_child();
  if (plain == 0) exit(real_main(argc, argv, environment));
  if (wait_for(plain) != 0) return 1;
  expected_size = read_file(getenv("ALLOCATIONS_OUTPUT"), expected, sizeof(expected));

  const pid_t forking = fork_child();
  if (forking == 0) {
    mode = kForking;
    const int code = real_main(argc, argv, environment);
    mode = kOff;
    exit(code);
  }
  if (wait_for(forking) != 0) return 1;

  const long num_allocations = shared->count;
  for (fail_at = shared->forked + 1; fail_at <= num_allocations; ++fail_at) {
    shared->count = 0;
    const pid_t child = fork_child();
    if (child == 0) {
      mode = kCounting;
      const int code = real_main(argc, argv, environment);
      mode = kOff;
      exit(code);
    }
    report(wait_for(child));
  }
  return real_main(argc, argv, environment);
}

int __libc_start_main(Main main, int argc, char** argv, void (*init)(void), void (*fini)(void),
                      void (*rtld_fini)(void), void* stack_end) {
  const Start start = (Start)dlsym(RTLD_NEXT, "__libc_start_main");
  real_main = main;
  return start(run_all, argc, argv, init, fini, rtld_fini, stack_end);
}
