#include "apps/results/output_folder.hpp"

#include <fstream>

#include "apps/documents/atomic_file.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::output_folder_test {
namespace {

using apps::FolderContent;
using nlohmann::json;
using tests::ContainsSubstring;
using tests::TemporaryFolder;

const json job = {{"model", {{"name", "duffing"}}}, {"seed", 1}, {"versions", {{"orbid", "0.1.0"}}}};

TEST_CASE("a new folder is created with its parents", "[apps]") {
    const TemporaryFolder folder;
    const auto path = folder.path() / "a" / "b";
    CHECK(apps::examine_output_folder(path, job).content == FolderContent::nothing);
    apps::prepare_output_folder(path, job, false);
    CHECK(std::filesystem::is_directory(path));
}

TEST_CASE("the same job under another version of the program is the same job", "[apps]") {
    const TemporaryFolder folder;
    json stored = job;
    stored["versions"]["orbid"] = "0.2.0";
    apps::write_atomically(folder.path() / "job.json", stored.dump(4));
    CHECK(apps::examine_output_folder(folder.path(), job).content == FolderContent::same_job);
    CHECK_NOTHROW(apps::prepare_output_folder(folder.path(), job, false));
}

TEST_CASE("the result of another job is not overwritten without force", "[apps]") {
    const TemporaryFolder folder;
    json stored = job;
    stored["model"]["name"] = "lotka_volterra";
    const std::string before = stored.dump();
    apps::write_atomically(folder.path() / "job.json", before);
    CHECK_THROWS_AS(apps::prepare_output_folder(folder.path(), job, false), apps::FolderRefused);
    CHECK_THROWS_WITH(apps::prepare_output_folder(folder.path(), job, false),
                      ContainsSubstring(folder.path().string()) && ContainsSubstring("--force") &&
                          ContainsSubstring("/model/name is \"lotka_volterra\" there, \"duffing\" in this job"));
    CHECK(apps::read_whole_file(folder.path() / "job.json") == before);
    CHECK(folder.entries() == 1);
    CHECK_NOTHROW(apps::prepare_output_folder(folder.path(), job, true));
}

TEST_CASE("files under our names without a job are not overwritten either", "[apps]") {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "notes.txt") << "mine";
    CHECK(apps::examine_output_folder(folder.path(), job).content == FolderContent::nothing);
    std::ofstream(folder.path() / "cycles.json") << "{}";
    CHECK_THROWS_WITH(apps::prepare_output_folder(folder.path(), job, false), ContainsSubstring("cycles.json"));
    std::ofstream(folder.path() / "job.json") << "{ broken";
    CHECK_THROWS_WITH(apps::prepare_output_folder(folder.path(), job, false), ContainsSubstring("cannot be read"));
}

TEST_CASE("a file where the folder should be is an error, with force too", "[apps]") {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "out") << "x";
    CHECK_THROWS_WITH(apps::prepare_output_folder(folder.path() / "out", job, true),
                      ContainsSubstring("is not a folder"));
}

TEST_CASE("two runs never write into one folder, with force neither", "[apps]") {
    const TemporaryFolder folder;
    const auto out = folder.path() / "out";
    {
        const apps::OutputFolder first(out, job, job.dump(), false);
        CHECK(first.is_locked());
        for (const bool force : {false, true})
            CHECK_THROWS_WITH(apps::OutputFolder(out, job, job.dump(), force),
                              ContainsSubstring("cannot store results in " + out.string() + ": process ") &&
                                  ContainsSubstring(" since ") && ContainsSubstring("choose another --out"));
    }
    CHECK_FALSE(std::filesystem::exists(out));  // nothing was stored
    apps::OutputFolder second(out, job, job.dump(), false);
    second.store("result.json", "{}");
    CHECK(apps::read_whole_file(out / "result.json") == "{}");
}

}  // namespace
}  // namespace orbid::output_folder_test
