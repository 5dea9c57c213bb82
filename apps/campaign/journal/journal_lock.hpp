#pragma once

#include <filesystem>

namespace orbid::apps {

/// The right to write a journal: a lock of the operating system on a file beside it, which ends with the process
/// however it ends. The file says who holds it.
class JournalLock {
public:
    /// @throws JournalError naming host and process id of the one that writes, or why the file cannot be made.
    explicit JournalLock(const std::filesystem::path& journal);
    ~JournalLock();
    JournalLock(const JournalLock&) = delete;
    JournalLock& operator=(const JournalLock&) = delete;

    /// campaign.lock beside campaign.sqlite.
    [[nodiscard]] static std::filesystem::path file(const std::filesystem::path& journal);

private:
    int descriptor_ = -1;
};

}  // namespace orbid::apps
