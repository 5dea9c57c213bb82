#include "apps/documents/atomic_file.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <stdexcept>
#include <string>

#include "models/system/stopped.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::atomic_file_test {
namespace {

using tests::ContainsSubstring;
using tests::TemporaryFolder;

TEST_CASE("a file is written whole and replaces the one before", "[apps]") {
    const TemporaryFolder folder;
    const auto path = folder.path() / "result.json";
    const std::string bytes("a\0b\n", 4);  // a zero byte is a byte like any other
    apps::write_atomically(path, std::string_view("before"));
    apps::write_atomically(path, bytes);
    CHECK(apps::read_whole_file(path) == bytes);
    CHECK(folder.entries() == 1);
}

TEST_CASE("a large file is given up on its way to the disk", "[apps]") {
    const TemporaryFolder folder;
    const auto path = folder.path() / "series.h5";
    apps::write_atomically(path, std::string_view("before"));
    const auto large = [](const std::filesystem::path& temporary) {
        std::ofstream(temporary) << std::string(std::size_t{1} << 26, 'x');
    };
    int asked = 0;
    CHECK_THROWS_AS(apps::write_atomically(path, large, [&asked] { return ++asked == 3; }), models::Stopped);
    CHECK(apps::read_whole_file(path) == "before");
    CHECK(folder.entries() == 1);
    apps::write_atomically(path, large, [] { return false; });
    CHECK(std::filesystem::file_size(path) == std::size_t{1} << 26);
}

TEST_CASE("a writer that fails leaves nothing behind and the old file as it was", "[apps]") {
    const TemporaryFolder folder;
    const auto path = folder.path() / "series.h5";
    apps::write_atomically(path, std::string_view("before"));
    const auto half = [](const std::filesystem::path& temporary) {
        std::ofstream(temporary) << "half";
        throw std::logic_error("the writer's own words");
    };
    CHECK_THROWS_WITH(apps::write_atomically(path, half), "the writer's own words");
    CHECK(apps::read_whole_file(path) == "before");
    CHECK(folder.entries() == 1);
}

TEST_CASE("a writer gets a path in the same folder with the same extension", "[apps]") {
    const TemporaryFolder folder;
    const auto path = folder.path() / "series.h5";
    std::filesystem::path given;
    apps::write_atomically(path, [&given](const std::filesystem::path& temporary) {
        given = temporary;
        std::ofstream(temporary) << "whole";
    });
    CHECK(given.parent_path() == folder.path());
    CHECK(given.extension() == ".h5");
    CHECK(given != path);
    CHECK(apps::read_whole_file(path) == "whole");
    CHECK(folder.entries() == 1);
}

TEST_CASE("a file that cannot be written or read is named with the reason", "[apps]") {
    const TemporaryFolder folder;
    const auto path = folder.path() / "absent" / "result.json";
    CHECK_THROWS_WITH(apps::write_atomically(path, std::string_view("x")),
                      ContainsSubstring(path.string()) && ContainsSubstring("No such file or directory"));
    CHECK_THROWS_WITH(apps::read_whole_file(path),
                      ContainsSubstring(path.string()) && ContainsSubstring("No such file or directory"));
    // A folder stands where the file shall go: the rename fails, the temporary must not stay.
    std::filesystem::create_directories(folder.path() / "taken" / "inside");
    CHECK_THROWS_AS(apps::write_atomically(folder.path() / "taken", std::string_view("x")), std::runtime_error);
    CHECK(folder.entries() == 1);
}

TEST_CASE("temporaries of processes that are no more, and old ones, are tidied away", "[apps]") {
    const TemporaryFolder folder;
    // A child that has ended, and was waited for: its number is free.
    const pid_t gone = ::fork();
    if (gone == 0) ::_exit(0);
    ::waitpid(gone, nullptr, 0);
    const std::string own = apps::temporary_start();
    const std::string process = std::to_string(::getpid());
    REQUIRE(own.starts_with(".orbid-tmp-" + process + "-"));
    const auto name = [&](pid_t number, int count) {
        std::string start = own;
        start.replace(own.find(process), process.size(), std::to_string(number));
        return start + std::to_string(count) + ".series.h5";
    };
    // Of another machine, whose processes are not known here.
    const std::string elsewhere = ".orbid-tmp-" + std::to_string(gone) + "-00000000-0.series.h5";
    for (const std::string& file :
         {name(gone, 0), name(::getpid(), 0), name(::getpid(), 1), elsewhere, std::string("mine.txt")})
        std::ofstream(folder.path() / file) << "x";
    const auto two_days_ago = std::filesystem::file_time_type::clock::now() - std::chrono::hours(48);
    std::filesystem::last_write_time(folder.path() / name(::getpid(), 1), two_days_ago);
    std::filesystem::last_write_time(folder.path() / "mine.txt", two_days_ago);
    apps::remove_leftover_temporaries(folder.path());
    CHECK_FALSE(std::filesystem::exists(folder.path() / name(gone, 0)));
    CHECK_FALSE(std::filesystem::exists(folder.path() / name(::getpid(), 1)));
    CHECK(std::filesystem::exists(folder.path() / name(::getpid(), 0)));
    CHECK(std::filesystem::exists(folder.path() / elsewhere));
    CHECK(folder.entries() == 3);
}

}  // namespace
}  // namespace orbid::atomic_file_test
