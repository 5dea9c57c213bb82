#include "apps/documents/file_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <ctime>
#include <system_error>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "apps/documents/printable.hpp"

namespace orbid::apps {
namespace {

std::string own_name() {
    std::array<char, 256> host{};
    if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
    const std::time_t now = std::time(nullptr);
    std::tm utc{};
    ::gmtime_r(&now, &utc);
    std::array<char, 40> time{};
    (void)std::strftime(time.data(), time.size(), "%Y-%m-%d %H:%M:%S", &utc);
    return fmt::format("process {} on {} since {} UTC", ::getpid(), host[0] != '\0' ? host.data() : "an unnamed host",
                       time.data());
}

/// What the holder wrote; it may be about to write.
std::string holder(int descriptor) {
    std::array<char, 400> text{};
    const ssize_t count = ::pread(descriptor, text.data(), text.size(), 0);
    std::string said(text.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
    said = said.substr(0, said.find('\n'));
    return said.empty() ? "another process" : printable(said);
}

/// Whether the path still leads to the opened file: a holder that ended may have removed it in between.
bool is_at(int descriptor, const std::filesystem::path& file) {
    struct stat opened {};
    struct stat named {};
    return ::fstat(descriptor, &opened) == 0 && ::lstat(file.c_str(), &named) == 0 && opened.st_dev == named.st_dev &&
           opened.st_ino == named.st_ino;
}

/// What a file system says that has no locks.
bool is_without_locks(int error) {
    return error == ENOLCK || error == ENOSYS || error == EOPNOTSUPP || error == EINVAL;
}

}  // namespace

FileLock::FileLock(std::filesystem::path file, Afterwards afterwards)
    : file_(std::move(file)), afterwards_(afterwards) {
    constexpr std::chrono::milliseconds patience(1000), between(10);
    const auto latest = std::chrono::steady_clock::now() + patience;
    while (true) {
        // A link would let a stranger choose the file that is written.
        descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
        if (descriptor_ < 0) throw std::system_error(errno, std::generic_category(), file_.string());
        const int failed = ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0 ? 0 : errno;
        if (is_without_locks(failed)) {
            effective_ = false;
            break;
        }
        if (failed == 0 && is_at(descriptor_, file_)) break;
        std::string who = failed == EWOULDBLOCK ? holder(descriptor_) : std::string();
        ::close(std::exchange(descriptor_, -1));
        if (failed != 0 && failed != EWOULDBLOCK && failed != EINTR)
            throw std::system_error(failed, std::generic_category(), file_.string());
        if (std::chrono::steady_clock::now() >= latest) throw LockHeld(who.empty() ? "another process" : who);
        std::this_thread::sleep_for(between);
    }
    const std::string name = own_name() + "\n";
    if (::ftruncate(descriptor_, 0) == 0) (void)!::write(descriptor_, name.data(), name.size());
}

FileLock::~FileLock() {
    if (afterwards_ == Afterwards::removed && is_at(descriptor_, file_)) {
        // While it is held: who opened the file in between sees that it is gone, and makes another.
        ::unlink(file_.c_str());
    } else {
        (void)!::ftruncate(descriptor_, 0);
    }
    ::close(descriptor_);
}

}  // namespace orbid::apps
