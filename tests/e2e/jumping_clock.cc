// The wall clock of a program that is started with LD_PRELOAD of this: it is off by the seconds, 8 bytes, in the file
// that $CAIRN_CLOCK_FILE names, whenever somebody changes them there. Nobody can change the machine's own clock in a
// test. Who waits until a time of the wall clock waits for that of this one; clocks that only count go on.
#include <dlfcn.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>

namespace {

std::int64_t OffsetS() {
  static const std::atomic<std::int64_t>* const offset = []() -> const std::atomic<std::int64_t>* {
    const char* path = std::getenv("CAIRN_CLOCK_FILE");
    const int file = path == nullptr ? -1 : open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) return nullptr;
    void* bytes = mmap(nullptr, sizeof(std::int64_t), PROT_READ, MAP_SHARED, file, 0);
    close(file);
    return bytes == MAP_FAILED ? nullptr : static_cast<const std::atomic<std::int64_t>*>(bytes);
  }();
  return offset == nullptr ? 0 : offset->load(std::memory_order_relaxed);
}

bool IsWallClock(clockid_t clock) { return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE; }

// As the machine has it.
timespec True(timespec time) {
  time.tv_sec -= OffsetS();
  if (time.tv_sec < 0) time = {};
  return time;
}

template <class Function>
Function* Next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) {
  using Call = int(clockid_t, timespec*);
  static Call* const next = Next<Call>("clock_gettime");
  const int result = next(clock, time);
  if (result == 0 && IsWallClock(clock)) time->tv_sec += OffsetS();
  return result;
}

int gettimeofday(timeval* time, void* /*zone*/) {
  timespec now{};
  const int result = clock_gettime(CLOCK_REALTIME, &now);
  *time = {now.tv_sec, now.tv_nsec / 1000};
  return result;
}

time_t time(time_t* out) {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  if (out != nullptr) *out = now.tv_sec;
  return now.tv_sec;
}

// Of condition variables it is not known by which clock they wait; times since the machine was started are small.
int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const timespec* until) {
  using Call = int(pthread_cond_t*, pthread_mutex_t*, const timespec*);
  static Call* const next = Next<Call>("pthread_cond_timedwait");
  constexpr time_t kNoUptime_s = 800'000'000;
  const timespec there = until->tv_sec > kNoUptime_s ? True(*until) : *until;
  return next(condition, mutex, &there);
}

int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock, const timespec* until) {
  using Call = int(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*);
  static Call* const next = Next<Call>("pthread_cond_clockwait");
  const timespec there = IsWallClock(clock) ? True(*until) : *until;
  return next(condition, mutex, clock, &there);
}

// Abseil's locks wait so.
long syscall(long number, ...) {
  using Call = long(long, ...);
  static Call* const next = Next<Call>("syscall");
  va_list list;
  va_start(list, number);
  long argument[6];
  for (long& value : argument) value = va_arg(list, long);
  va_end(list);
  timespec there{};
  if (number == SYS_futex && (argument[1] & FUTEX_CLOCK_REALTIME) != 0 && argument[3] != 0) {
    there = True(*reinterpret_cast<const timespec*>(argument[3]));
    argument[3] = reinterpret_cast<long>(&there);
  }
  return next(number, argument[0], argument[1], argument[2], argument[3], argument[4], argument[5]);
}
}
