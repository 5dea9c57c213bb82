#pragma once

#include <filesystem>
#include <optional>

#include "apps/documents/file_lock.hpp"

namespace orbid::apps {

/// The right to write a journal: a lock of the operating system on a file beside it, which ends with the process
/// however it ends. The file says who holds it.
class JournalLock {
public:
    /// @throws JournalError naming host and process id of the one that writes, or why the file cannot be made.
    explicit JournalLock(const std::filesystem::path& journal);

    /// campaign.lock beside campaign.sqlite.
    [[nodiscard]] static std::filesystem::path file(const std::filesystem::path& journal);

private:
    std::optional<FileLock> lock_;
};

}  // namespace orbid::apps
