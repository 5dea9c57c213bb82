#include "apps/documents/file_lock.hpp"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <system_error>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::file_lock_test {
namespace {

using apps::FileLock;
using tests::ContainsSubstring;
using tests::TemporaryFolder;

TEST_CASE("a lock is held once, also within a process, and says by whom", "[apps]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "lock";
    {
        const FileLock first(file, FileLock::Afterwards::removed);
        CHECK(first.effective());
        CHECK_THROWS_AS(FileLock(file, FileLock::Afterwards::removed), apps::LockHeld);
        CHECK_THROWS_WITH(
            FileLock(file, FileLock::Afterwards::removed),
            ContainsSubstring(fmt::format("process {} on ", ::getpid())) && ContainsSubstring(" since 20"));
    }
    CHECK(folder.entries() == 0);
    { const FileLock again(file, FileLock::Afterwards::kept_empty); }
    CHECK(apps::read_whole_file(file).empty());
}

TEST_CASE("a killed process leaves the file of a lock, but not the lock", "[apps]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "lock";
    int told[2];
    REQUIRE(::pipe(told) == 0);
    const pid_t child = ::fork();
    if (child == 0) {
        const FileLock lock(file, FileLock::Afterwards::removed);
        (void)!::write(told[1], "x", 1);
        ::pause();
    }
    char byte = 0;
    REQUIRE(::read(told[0], &byte, 1) == 1);
    CHECK_THROWS_WITH(FileLock(file, FileLock::Afterwards::removed),
                      ContainsSubstring(fmt::format("process {}", child)));
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    CHECK(std::filesystem::exists(file));
    CHECK_NOTHROW(FileLock(file, FileLock::Afterwards::removed));
    CHECK_FALSE(std::filesystem::exists(file));
}

TEST_CASE("a lock does not follow a link, and needs its folder", "[apps]") {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "other") << "untouched";
    std::filesystem::create_symlink(folder.path() / "other", folder.path() / "lock");
    CHECK_THROWS_AS(FileLock(folder.path() / "lock", FileLock::Afterwards::removed), std::system_error);
    CHECK(apps::read_whole_file(folder.path() / "other") == "untouched");
    CHECK_THROWS_AS(FileLock(folder.path() / "none" / "lock", FileLock::Afterwards::removed), std::system_error);
}

TEST_CASE("what a stranger wrote into the file of a lock is not obeyed", "[apps]") {
    const TemporaryFolder folder;
    const auto file = folder.path() / "lock";
    const FileLock lock(file, FileLock::Afterwards::removed);
    std::ofstream(file) << "\x1b[2Jsomebody";
    CHECK_THROWS_WITH(FileLock(file, FileLock::Afterwards::removed), "\\u001b[2Jsomebody");
}

}  // namespace
}  // namespace orbid::file_lock_test
