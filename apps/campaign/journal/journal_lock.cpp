#include "apps/campaign/journal/journal_lock.hpp"

#include <system_error>

#include <fmt/format.h>

#include "apps/campaign/journal/journal.hpp"

namespace orbid::apps {

std::filesystem::path JournalLock::file(const std::filesystem::path& journal) {
    auto path = journal;
    return path.replace_extension(".lock");
}

JournalLock::JournalLock(const std::filesystem::path& journal) {
    const auto path = file(journal);
    try {
        lock_.emplace(path, FileLock::Afterwards::kept_empty);
    } catch (const LockHeld& held) {
        throw JournalError(
            fmt::format("{} is being written by {}: one program writes at a time", journal.string(), held.what()));
    } catch (const std::system_error& error) {
        throw JournalError(
            fmt::format("cannot lock {}: {}: {}", journal.string(), path.string(), error.code().message()));
    }
}

}  // namespace orbid::apps
