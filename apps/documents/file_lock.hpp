#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

namespace orbid::apps {

/// Somebody else holds a lock; what() names who: process, host and since when, as the holder wrote it.
class LockHeld : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// A lock of the operating system (flock) on a file. It ends with the process, however that ends: a killed program
/// leaves the file behind, but not the lock. The file says for people who holds it.
///
/// On NFS, Linux makes it a lock of the server, which holds between hosts. A mount with `local_lock` or `nolock` knows
/// it on one host only, and a host that lost its power keeps it until the server's lease ends (90 s by default). A file
/// system without locks gives none: see effective().
class FileLock {
public:
    /// What becomes of the file when the lock is released.
    enum class Afterwards { kept_empty, removed };

    /// Waits up to a second: children of a program that was just killed hold its lock until they end, too.
    /// @throws LockHeld; std::system_error when the file cannot be opened or made, ENOENT without its folder.
    FileLock(std::filesystem::path file, Afterwards afterwards);
    ~FileLock();
    FileLock(const FileLock&) = delete;
    FileLock& operator=(const FileLock&) = delete;

    /// False where the file system has no locks; nobody is kept out then.
    [[nodiscard]] bool effective() const { return effective_; }

private:
    std::filesystem::path file_;
    Afterwards afterwards_;
    int descriptor_ = -1;
    bool effective_ = true;
};

}  // namespace orbid::apps
