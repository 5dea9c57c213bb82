#include "apps/campaign/journal/journal_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <string>
#include <system_error>
#include <thread>

#include <fmt/format.h>

#include "apps/campaign/journal/journal.hpp"
#include "apps/documents/atomic_file.hpp"

namespace orbid::apps {
namespace {

std::string own_name() {
    std::array<char, 256> host{};
    if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
    return fmt::format("process {} on {}", ::getpid(), host[0] != '\0' ? host.data() : "an unnamed host");
}

/// What the holder wrote; it may be about to write.
std::string holder(const std::filesystem::path& file) {
    std::string said;
    try {
        said = read_whole_file(file);
    } catch (const std::runtime_error&) {
    }
    said = said.substr(0, said.find('\n'));
    return said.empty() ? "another process" : said;
}

}  // namespace

std::filesystem::path JournalLock::file(const std::filesystem::path& journal) {
    auto path = journal;
    return path.replace_extension(".lock");
}

JournalLock::JournalLock(const std::filesystem::path& journal) {
    const auto path = file(journal);
    descriptor_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor_ < 0)
        throw JournalError(fmt::format("cannot lock {}: {}: {}", journal.string(), path.string(),
                                       std::generic_category().message(errno)));
    // Children of a program that was just killed have its lock until they end, too.
    constexpr std::chrono::milliseconds patience(1000), between(10);
    const auto latest = std::chrono::steady_clock::now() + patience;
    int failed = ::flock(descriptor_, LOCK_EX | LOCK_NB);
    while (failed != 0 && errno == EWOULDBLOCK && std::chrono::steady_clock::now() < latest) {
        std::this_thread::sleep_for(between);
        failed = ::flock(descriptor_, LOCK_EX | LOCK_NB);
    }
    if (failed != 0) {
        const int error = errno;
        ::close(descriptor_);
        if (error != EWOULDBLOCK)
            throw JournalError(
                fmt::format("cannot lock {}: {}", journal.string(), std::generic_category().message(error)));
        throw JournalError(
            fmt::format("{} is being written by {}: one program writes at a time", journal.string(), holder(path)));
    }
    // Who holds it is said for people; the lock itself does not depend on it.
    const std::string name = own_name() + "\n";
    if (::ftruncate(descriptor_, 0) == 0) (void)!::write(descriptor_, name.data(), name.size());
}

JournalLock::~JournalLock() {
    (void)!::ftruncate(descriptor_, 0);
    ::close(descriptor_);
}

}  // namespace orbid::apps
