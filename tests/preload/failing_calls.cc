// SPDX-License-Identifier: Apache-2.0
// A library that lets one allocation or one start of a thread fail in the process that loads it
// with LD_PRELOAD, whichever thread asks for it. The tests choose which one in the file that
// KDRAY_FAULTS names (tests/scenarios/service.py).
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* block, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
}

namespace {

/// How many calls of a kind go well before one fails; none fails while it is negative.
struct Countdowns {
  std::atomic<std::int64_t> allocations, threads;
};

Countdowns never = {{-1}, {-1}};
std::atomic<Countdowns*> countdowns{&never};

[[gnu::constructor]] void MapTheFile() {
  const char* const path = std::getenv("KDRAY_FAULTS");
  const int fd = path == nullptr ? -1 : open(path, O_RDWR | O_CLOEXEC);
  if (fd < 0) return;
  void* const map = mmap(nullptr, sizeof(Countdowns), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  close(fd);
  if (map != MAP_FAILED) countdowns = static_cast<Countdowns*>(map);
}

bool Fails(std::atomic<std::int64_t>& left) {
  return left.load(std::memory_order_relaxed) >= 0 && left.fetch_sub(1) == 0;
}

bool AllocationFails() {
  if (!Fails(countdowns.load(std::memory_order_relaxed)->allocations)) return false;
  errno = ENOMEM;
  return true;
}

}  // namespace

// The names and signatures are the C library's.
// NOLINTBEGIN(readability-identifier-naming)
extern "C" {

void* malloc(std::size_t size) { return AllocationFails() ? nullptr : __libc_malloc(size); }

void* calloc(std::size_t count, std::size_t size) {
  return AllocationFails() ? nullptr : __libc_calloc(count, size);
}

void* realloc(void* block, std::size_t size) {
  return AllocationFails() ? nullptr : __libc_realloc(block, size);
}

void* memalign(std::size_t alignment, std::size_t size) {
  return AllocationFails() ? nullptr : __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) { return memalign(alignment, size); }

int posix_memalign(void** block, std::size_t alignment, std::size_t size) {
  *block = memalign(alignment, size);
  return *block == nullptr ? ENOMEM : 0;
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                   void* argument) {
  using Create = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
  static const auto create = reinterpret_cast<Create>(dlsym(RTLD_NEXT, "pthread_create"));
  if (Fails(countdowns.load(std::memory_order_relaxed)->threads)) return EAGAIN;
  return create(thread, attributes, run, argument);
}
}
// NOLINTEND(readability-identifier-naming)
