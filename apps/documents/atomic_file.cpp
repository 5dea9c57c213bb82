#include "apps/documents/atomic_file.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <stdexcept>
#include <string>
#include <system_error>

#include <fmt/format.h>

#include "apps/documents/fingerprint.hpp"
#include "models/definition/wrong_data.hpp"
#include "models/system/stopped.hpp"

namespace orbid::apps {
namespace {

constexpr std::string_view temporary_prefix = ".orbid-tmp-";

[[noreturn]] void fail(std::string_view what, const std::filesystem::path& path, int error) {
    throw FileNotWritten(fmt::format("cannot {} {}: {}", what, path.string(), std::generic_category().message(error)));
}

/// An open file that is closed whatever happens.
class Descriptor {
public:
    explicit Descriptor(int value) : value_(value) {}
    ~Descriptor() {
        if (value_ >= 0) ::close(value_);
    }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    [[nodiscard]] int value() const { return value_; }
    [[nodiscard]] int close() {
        const int result = ::close(value_);
        value_ = -1;
        return result;
    }

private:
    int value_;
};

/// A path beside the final one that disappears unless it was renamed.
class Temporary {
public:
    explicit Temporary(const std::filesystem::path& final_path) {
        static std::atomic<unsigned> counter{0};
        path_ = final_path.parent_path() /
                fmt::format("{}{}.{}", temporary_start(), counter++, final_path.filename().string());
    }
    ~Temporary() {
        if (!renamed_) {
            std::error_code ignored;
            std::filesystem::remove(path_, ignored);
        }
    }
    Temporary(const Temporary&) = delete;
    Temporary& operator=(const Temporary&) = delete;

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

    void rename_to(const std::filesystem::path& final_path) {
        if (::rename(path_.c_str(), final_path.c_str()) != 0) fail("write", final_path, errno);
        renamed_ = true;
        sync_folder(final_path);
    }

private:
    /// The rename itself must reach the disk. Some file systems cannot sync folders and say EINVAL: nothing to do then.
    static void sync_folder(const std::filesystem::path& final_path) {
        const auto folder = final_path.has_parent_path() ? final_path.parent_path() : std::filesystem::path(".");
        const Descriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
        if (opened.value() < 0 || (::fsync(opened.value()) != 0 && errno != EINVAL))
            fail("sync the folder of", final_path, errno);
    }

    std::filesystem::path path_;
    bool renamed_ = false;
};

void write_all(int descriptor, std::string_view bytes, const std::filesystem::path& path) {
    while (!bytes.empty()) {
        const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
        if (written < 0) {
            if (errno == EINTR) continue;
            fail("write", path, errno);
        }
        bytes.remove_prefix(static_cast<std::size_t>(written));
    }
}

/// Lets a writer write a temporary. What it says is wrong is said of the file that this stands for.
void write_there(const std::function<void(const std::filesystem::path& temporary)>& writer,
                 const std::filesystem::path& temporary, const std::filesystem::path& path) {
    try {
        writer(temporary);
    } catch (const models::DataError& error) {
        std::string said = error.what();
        const std::string name = temporary.string();
        if (const auto at = said.find(name); at != std::string::npos) said.replace(at, name.size(), path.string());
        throw FileNotWritten(said);
    }
}

/// Sends a large file to the disk piece by piece and asks in between. Nothing is promised: fsync follows.
void sync_in_blocks(int descriptor, const std::function<bool()>& interrupted) {
    constexpr off_t block = 1 << 24;
    const off_t size = interrupted ? ::lseek(descriptor, 0, SEEK_END) : 0;
    for (off_t start = 0; start < size; start += block) {
        models::stop_if_asked(interrupted);
        ::sync_file_range(descriptor, start, block,
                          SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER);
    }
}

}  // namespace

void write_atomically(const std::filesystem::path& path, std::string_view bytes) {
    Temporary temporary(path);
    // 0666: the user's umask decides, as for any file a program creates.
    Descriptor file(::open(temporary.path().c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (file.value() < 0) fail("write", path, errno);
    write_all(file.value(), bytes, path);
    if (::fsync(file.value()) != 0 || file.close() != 0) fail("write", path, errno);
    temporary.rename_to(path);
}

void write_atomically(const std::filesystem::path& path,
                      const std::function<void(const std::filesystem::path& temporary)>& writer,
                      const std::function<bool()>& interrupted) {
    Temporary temporary(path);
    {
        // HDF5 and streams would follow a link that somebody put there.
        const Descriptor made(::open(temporary.path().c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
        if (made.value() < 0) fail("write", path, errno);
    }
    write_there(writer, temporary.path(), path);
    {
        const Descriptor file(::open(temporary.path().c_str(), O_RDONLY | O_CLOEXEC));
        if (file.value() >= 0) sync_in_blocks(file.value(), interrupted);
        if (file.value() < 0 || ::fsync(file.value()) != 0) fail("write", path, errno);
    }
    temporary.rename_to(path);
}

namespace {

std::string machine_digest() {
    std::array<char, 256> host{};
    if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
    return sha256(host.data()).substr(0, 8);
}

/// The process that a temporary is named after was one of this machine, and is no more.
bool is_orphaned(std::string_view name) {
    name.remove_prefix(temporary_prefix.size());
    pid_t process = 0;
    const char* const last = name.data() + name.size();
    const auto [end, error] = std::from_chars(name.data(), last, process);
    return error == std::errc() && std::string_view(end, last).starts_with(fmt::format("-{}-", machine_digest())) &&
           process > 0 && ::kill(process, 0) != 0 && errno == ESRCH;
}

}  // namespace

std::string temporary_start() {
    return fmt::format("{}{}-{}-", temporary_prefix, ::getpid(), machine_digest());
}

void remove_leftover_temporaries(const std::filesystem::path& folder, std::string_view file) {
    std::error_code error;
    const std::string ending = file.empty() ? std::string() : fmt::format(".{}", file);
    const auto now = std::filesystem::file_time_type::clock::now();
    std::filesystem::directory_iterator entry(folder, error);
    for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
        std::error_code ignored;
        const auto touched = entry->last_write_time(ignored);
        const std::string name = entry->path().filename().string();
        if (ignored || !name.starts_with(temporary_prefix) || !name.ends_with(ending)) continue;
        if (is_orphaned(name) || now - touched > std::chrono::hours(24))
            std::filesystem::remove_all(entry->path(), ignored);
    }
}

namespace {

[[noreturn]] void unreadable(const std::filesystem::path& path, std::string_view why) {
    throw FileUnreadable(fmt::format("cannot read {}: {}", path.string(), why));
}

/// Not waiting for somebody to write into a pipe.
Descriptor opened(const std::filesystem::path& path, bool pipes) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | (pipes ? 0 : O_NONBLOCK));
    if (descriptor < 0) unreadable(path, std::generic_category().message(errno));
    return Descriptor(descriptor);
}

}  // namespace

std::string read_whole_file(const std::filesystem::path& path, std::uintmax_t most, bool pipes) {
    const Descriptor file = opened(path, pipes);
    struct stat status {};
    if (::fstat(file.value(), &status) != 0) unreadable(path, std::generic_category().message(errno));
    if (S_ISDIR(status.st_mode)) unreadable(path, std::generic_category().message(EISDIR));
    if (!S_ISREG(status.st_mode) && !(pipes && S_ISFIFO(status.st_mode)))
        unreadable(path, "it is a device or a pipe, not a file");
    const auto too_large = [&] { unreadable(path, fmt::format("it has more than {} bytes", most)); };
    if (static_cast<std::uintmax_t>(status.st_size) > most) too_large();
    std::string bytes;
    bytes.reserve(static_cast<std::size_t>(status.st_size));
    std::string buffer(std::size_t{1} << 16, '\0');  // large enough that system calls do not matter
    while (true) {
        const ssize_t got = ::read(file.value(), buffer.data(), buffer.size());
        if (got == 0) return bytes;
        if (got < 0) {
            if (errno == EINTR) continue;
            unreadable(path, std::generic_category().message(errno));
        }
        bytes.append(buffer.data(), static_cast<std::size_t>(got));
        if (bytes.size() > most) too_large();
    }
}

}  // namespace orbid::apps
