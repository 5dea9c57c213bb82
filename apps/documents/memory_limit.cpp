#include "apps/documents/memory_limit.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

/// A number [kB] behind a word of a file below /proc, in bytes. Without a buffer on the heap, which is full.
std::optional<std::uint64_t> bytes_of(const char* file, std::string_view word) {
    std::array<char, 4096> text{};
    const int descriptor = ::open(file, O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) return std::nullopt;
    const ssize_t length = ::read(descriptor, text.data(), text.size());
    ::close(descriptor);
    std::string_view rest(text.data(), length > 0 ? static_cast<std::size_t>(length) : 0);
    const auto at = rest.find(word);
    if (at == std::string_view::npos) return std::nullopt;
    rest.remove_prefix(at + word.size());
    rest.remove_prefix(std::min(rest.find_first_of("0123456789"), rest.size()));
    std::uint64_t kilobytes = 0;
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), kilobytes);
    constexpr std::uint64_t kilo = 1024;
    return error == std::errc() ? std::optional(kilobytes * kilo) : std::nullopt;
}

std::string megabytes(std::optional<std::uint64_t> bytes) {
    constexpr double mega = 1e6;
    return bytes ? fmt::format("{:.0f} MB", static_cast<double>(*bytes) / mega) : "an unknown number of MB";
}

std::optional<std::uint64_t> limit_of(__rlimit_resource_t resource) {
    rlimit limit{};
    if (::getrlimit(resource, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return std::nullopt;
    return limit.rlim_cur;
}

}  // namespace

std::string out_of_memory_text() {
    constexpr const char* status = "/proc/self/status";
    const std::string cure = "use fewer threads (--threads) or a shorter record, or allow more";
    if (const auto limit = limit_of(RLIMIT_AS))
        return fmt::format("out of memory: {} of addresses are in use, the limit is {} (ulimit -v); {}",
                           megabytes(bytes_of(status, "VmSize:")), megabytes(limit), cure);
    if (const auto limit = limit_of(RLIMIT_DATA))
        return fmt::format("out of memory: {} of data are in use, the limit is {} (ulimit -d); {}",
                           megabytes(bytes_of(status, "VmData:")), megabytes(limit), cure);
    return fmt::format("out of memory: at most {} were in use, and the machine has {} left; {}",
                       megabytes(bytes_of(status, "VmHWM:")), megabytes(bytes_of("/proc/meminfo", "MemAvailable:")),
                       cure);
}

}  // namespace orbid::apps
