// Preloaded into a program (LD_PRELOAD): makes the k-th call of one kind fail.
//
//   ORBID_FAULT          KIND:K:ERROR[:on]  ERROR is a number of errno; "on": every later call, too. Of memory: it is
//                        full from then on, and an allocation succeeds in what was freed since.
//                        ERROR "kill" ends the process by SIGKILL in its place, "short" writes half of what was asked.
//   ORBID_FAULT_PROGRAM  path of the program that is meant; programs that it starts are left alone
//   ORBID_FAULT_LOG      file to append to: "fired KIND K", and at the end "calls KIND N"
//
// Allocations of the HDF5 library itself are left out: it crashes where it does not look at their result (1.10.8).
//
// Kinds: write, sync, rename, open, mmap, memory, read, close. Calls are counted from main on, in all threads and
// forked processes together. Standard output and error are never touched: a terminal is no place for results.

#include <dlfcn.h>
#include <execinfo.h>
#include <fcntl.h>
#include <link.h>
#include <malloc.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#define EXPORTED extern "C" __attribute__((visibility("default")))

// What malloc of the C library is called when it is not this one.
extern "C" void* __libc_malloc(std::size_t);
extern "C" void* __libc_calloc(std::size_t, std::size_t);
extern "C" void* __libc_realloc(void*, std::size_t);
extern "C" void* __libc_memalign(std::size_t, std::size_t);
extern "C" void __libc_free(void*);

namespace {

enum Kind { write_kind, sync_kind, rename_kind, open_kind, mmap_kind, memory_kind, read_kind, close_kind, kinds };
constexpr const char* names[kinds] = {"write", "sync", "rename", "open", "mmap", "memory", "read", "close"};
constexpr int kill_now = -1, half = -2;

struct Counters {
    std::atomic<long> calls;
    std::atomic<long> freed;  ///< bytes, since memory was full
};

// Plain data alone: it is used before constructors and after destructors.
Kind chosen = kinds;
long wanted = 0;
int with_error = 0;
bool and_later = false;
std::atomic<bool> armed{false};
Counters* counters = nullptr;  // shared with forked processes
char log_file[PATH_MAX] = "";

void tell(const char* what, long number) {
    char line[100];
    const int length = std::snprintf(line, sizeof(line), "%s %s %ld\n", what, names[chosen], number);
    const long file = syscall(SYS_openat, AT_FDCWD, log_file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (file < 0) return;
    (void)syscall(SYS_write, file, line, static_cast<std::size_t>(length));
    (void)syscall(SYS_close, file);
}

/// Counts a call; true: it is to fail, with errno set.
bool fails(Kind kind) {
    if (kind != chosen || !armed.load(std::memory_order_relaxed)) return false;
    const long call = ++counters->calls;
    if (call != wanted && !(and_later && call > wanted && wanted > 0)) return false;
    if (call == wanted) tell("fired", call);
    if (with_error == kill_now) (void)syscall(SYS_kill, syscall(SYS_getpid), SIGKILL);
    errno = with_error > 0 ? with_error : ENOSPC;
    return true;
}

template <class Function>
Function next(const char* name) {
    return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

bool is_meant() {
    const char* program = std::getenv("ORBID_FAULT_PROGRAM");
    char path[PATH_MAX];
    const ssize_t length = readlink("/proc/self/exe", path, sizeof(path) - 1);
    if (program == nullptr || length <= 0) return false;
    path[length] = '\0';
    return std::strcmp(path, program) == 0;
}

void read_order() {
    const char* order = std::getenv("ORBID_FAULT");
    const char* log = std::getenv("ORBID_FAULT_LOG");
    if (order == nullptr || log == nullptr || !is_meant()) return;
    std::snprintf(log_file, sizeof(log_file), "%s", log);
    char kind[20] = "", error[20] = "", on[4] = "";
    if (std::sscanf(order, "%19[^:]:%ld:%19[^:]:%3s", kind, &wanted, error, on) < 3) return;
    for (int i = 0; i < kinds; ++i)
        if (std::strcmp(kind, names[i]) == 0) chosen = static_cast<Kind>(i);
    with_error = std::strcmp(error, "kill") == 0    ? kill_now
                 : std::strcmp(error, "short") == 0 ? half
                                                    : std::atoi(error);
    and_later = std::strcmp(on, "on") == 0;
    void* shared = reinterpret_cast<void*>(
        syscall(SYS_mmap, nullptr, sizeof(Counters), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
    if (shared != MAP_FAILED) counters = static_cast<Counters*>(shared);
}

using Main = int (*)(int, char**, char**);
Main program_main = nullptr;

int counted_main(int count, char** arguments, char** environment) {
    read_order();
    void* none[2];
    (void)backtrace(none, 2);  // loads what it needs
    armed = chosen != kinds && counters != nullptr;
    const int code = program_main(count, arguments, environment);
    if (armed) tell("calls", counters->calls.load());
    return code;
}

}  // namespace

EXPORTED int __libc_start_main(Main main, int count, char** arguments, void (*init)(), void (*fini)(), void (*loader)(),
                               void* stack_end) {
    using Start = int (*)(Main, int, char**, void (*)(), void (*)(), void (*)(), void*);
    program_main = main;
    return next<Start>("__libc_start_main")(counted_main, count, arguments, init, fini, loader, stack_end);
}

// The pointer to the next function is found once, at the first call.
#define NEXT(name) static const auto real = next<decltype(&name)>(#name)

// --- memory. Through the other names of the C library: dlsym allocates.

namespace {

std::atomic<std::uintptr_t> spared_begin{0}, spared_end{0};  ///< the code of the HDF5 library

int note_hdf5(dl_phdr_info* loaded, std::size_t, void*) {
    if (std::strstr(loaded->dlpi_name, "libhdf5") == nullptr) return 0;
    for (int i = 0; i < loaded->dlpi_phnum; ++i) {
        const auto& part = loaded->dlpi_phdr[i];
        if (part.p_type != PT_LOAD || (part.p_flags & PF_X) == 0) continue;
        spared_begin = loaded->dlpi_addr + part.p_vaddr;
        spared_end = loaded->dlpi_addr + part.p_vaddr + part.p_memsz;
    }
    return 1;
}

/// Whether the HDF5 library is among the callers.
bool is_spared() {
    if (spared_end.load(std::memory_order_relaxed) == 0) return false;
    void* callers[64];
    const int count = backtrace(callers, 64);
    for (int i = 0; i < count; ++i) {
        const auto from = reinterpret_cast<std::uintptr_t>(callers[i]);
        if (from >= spared_begin && from < spared_end) return true;
    }
    return false;
}

bool refused(std::size_t size) {
    if (chosen != memory_kind || !armed.load(std::memory_order_relaxed)) return false;
    // Looked at only where a call would fail: walking the stack takes long.
    if (counters->calls.load() + 1 >= wanted && (and_later || counters->calls.load() + 1 == wanted) && is_spared())
        return false;
    if (!fails(memory_kind)) return false;
    const auto bytes = static_cast<long>(size);
    if (!and_later || counters->calls.load() == wanted || counters->freed.load() < bytes) return true;
    counters->freed -= bytes;
    return false;
}

}  // namespace

EXPORTED void* malloc(std::size_t size) {
    return refused(size) ? nullptr : __libc_malloc(size);
}
EXPORTED void* calloc(std::size_t count, std::size_t size) {
    return refused(count * size) ? nullptr : __libc_calloc(count, size);
}
EXPORTED void free(void* old) {
    if (old != nullptr && and_later && chosen == memory_kind && armed && counters->calls.load() >= wanted)
        counters->freed += static_cast<long>(malloc_usable_size(old));
    __libc_free(old);
}
EXPORTED void* realloc(void* old, std::size_t size) {
    return size > 0 && refused(size) ? nullptr : __libc_realloc(old, size);
}
EXPORTED void* memalign(std::size_t alignment, std::size_t size) {
    return refused(size) ? nullptr : __libc_memalign(alignment, size);
}
EXPORTED void* aligned_alloc(std::size_t alignment, std::size_t size) {
    return refused(size) ? nullptr : __libc_memalign(alignment, size);
}
EXPORTED int posix_memalign(void** result, std::size_t alignment, std::size_t size) {
    if (refused(size)) return ENOMEM;
    *result = __libc_memalign(alignment, size);
    return *result == nullptr ? ENOMEM : 0;
}

EXPORTED void* dlopen(const char* file, int mode) {
    NEXT(dlopen);
    void* const library = real(file, mode);
    if (chosen == memory_kind && file != nullptr && std::strstr(file, "hdf5") != nullptr)
        dl_iterate_phdr(note_hdf5, nullptr);
    return library;
}

EXPORTED void* mmap(void* address, std::size_t length, int protection, int flags, int file, off_t offset) {
    if (fails(mmap_kind)) return MAP_FAILED;
    NEXT(mmap);
    return real(address, length, protection, flags, file, offset);
}
EXPORTED void* mmap64(void* address, std::size_t length, int protection, int flags, int file, off64_t offset) {
    return mmap(address, length, protection, flags, file, offset);
}

// --- writing

EXPORTED ssize_t write(int file, const void* data, std::size_t size) {
    NEXT(write);
    if (file > STDERR_FILENO && fails(write_kind))
        return with_error == half && size > 1 ? real(file, data, size / 2) : -1;
    return real(file, data, size);
}
EXPORTED ssize_t pwrite64(int file, const void* data, std::size_t size, off64_t at) {
    NEXT(pwrite64);
    if (fails(write_kind)) return with_error == half && size > 1 ? real(file, data, size / 2, at) : -1;
    return real(file, data, size, at);
}
EXPORTED ssize_t pwrite(int file, const void* data, std::size_t size, off_t at) {
    return pwrite64(file, data, size, at);
}
EXPORTED ssize_t writev(int file, const iovec* parts, int count) {
    NEXT(writev);
    if (file > STDERR_FILENO && fails(write_kind))
        return with_error == half && parts[0].iov_len > 1 ? write(file, parts[0].iov_base, parts[0].iov_len / 2) : -1;
    return real(file, parts, count);
}
EXPORTED std::size_t fwrite(const void* data, std::size_t size, std::size_t count, FILE* stream) {
    NEXT(fwrite);
    if (stream != stdout && stream != stderr && fails(write_kind)) return 0;
    return real(data, size, count, stream);
}
EXPORTED int fflush(FILE* stream) {
    NEXT(fflush);
    if (stream != nullptr && stream != stdout && stream != stderr && fails(write_kind)) return EOF;
    return real(stream);
}

EXPORTED int fsync(int file) {
    NEXT(fsync);
    return fails(sync_kind) ? -1 : real(file);
}
EXPORTED int fdatasync(int file) {
    NEXT(fdatasync);
    return fails(sync_kind) ? -1 : real(file);
}

EXPORTED int rename(const char* from, const char* to) noexcept {
    NEXT(rename);
    return fails(rename_kind) ? -1 : real(from, to);
}
EXPORTED int link(const char* from, const char* to) noexcept {
    NEXT(link);
    return fails(rename_kind) ? -1 : real(from, to);
}

// --- opening

#define OPENED(name, ...)                                             \
    NEXT(name);                                                       \
    mode_t mode = 0;                                                  \
    if ((flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE) { \
        va_list rest;                                                 \
        va_start(rest, flags);                                        \
        mode = va_arg(rest, mode_t);                                  \
        va_end(rest);                                                 \
    }                                                                 \
    return fails(open_kind) ? -1 : real(__VA_ARGS__, flags, mode)

EXPORTED int open(const char* path, int flags, ...) {
    OPENED(open, path);
}
EXPORTED int open64(const char* path, int flags, ...) {
    OPENED(open64, path);
}
EXPORTED int openat(int folder, const char* path, int flags, ...) {
    OPENED(openat, folder, path);
}
EXPORTED int openat64(int folder, const char* path, int flags, ...) {
    OPENED(openat64, folder, path);
}
EXPORTED FILE* fopen(const char* path, const char* mode) {
    NEXT(fopen);
    return fails(open_kind) ? nullptr : real(path, mode);
}
EXPORTED FILE* fopen64(const char* path, const char* mode) {
    NEXT(fopen64);
    return fails(open_kind) ? nullptr : real(path, mode);
}

// --- reading and closing

EXPORTED ssize_t read(int file, void* data, std::size_t size) {
    NEXT(read);
    return fails(read_kind) ? -1 : real(file, data, size);
}
EXPORTED ssize_t pread64(int file, void* data, std::size_t size, off64_t at) {
    NEXT(pread64);
    return fails(read_kind) ? -1 : real(file, data, size, at);
}
EXPORTED ssize_t pread(int file, void* data, std::size_t size, off_t at) {
    return pread64(file, data, size, at);
}
EXPORTED std::size_t fread(void* data, std::size_t size, std::size_t count, FILE* stream) {
    NEXT(fread);
    return fails(read_kind) ? 0 : real(data, size, count, stream);
}
EXPORTED int close(int file) {
    NEXT(close);
    // Closed all the same: that is what Linux does.
    const int result = real(file);
    if (file > STDERR_FILENO && fails(close_kind)) return -1;
    return result;
}
