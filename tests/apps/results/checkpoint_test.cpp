// What a run keeps stands in its checkpoint, under its names, and nothing else is taken up.
#include "apps/results/checkpoint.hpp"

#include <string>

#include "apps/documents/atomic_file.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::checkpoint_test {

using apps::Checkpoint;
using apps::Fingerprint;

namespace {

std::string recalled(const Checkpoint& checkpoint, const std::string& name) {
    std::string value;
    return checkpoint.recall(name, value) ? value : "none";
}

void keep(Checkpoint& checkpoint, const std::string& name, std::string value) {
    checkpoint.keep(name, value);
}

/// The folder of a run.
struct Run {
    TemporaryFolder place;
    apps::OutputFolder folder{place.path() / "out", json::object(), "{}", false};

    [[nodiscard]] Checkpoint checkpoint(const char* sha256 = "ab") {
        Fingerprint fingerprint;
        fingerprint.sha256 = sha256;
        return {folder, fingerprint};
    }
};

}  // namespace

TEST_CASE("values of a checkpoint are recalled by name, the last one of each", "[apps][checkpoint]") {
    Run run;
    {
        Checkpoint checkpoint = run.checkpoint();
        CHECK(recalled(checkpoint, "one") == "none");
        keep(checkpoint, "one", "first");
        keep(checkpoint, "two", std::string(100000, 'x'));
        keep(checkpoint, "one", "a longer value than the first");
    }
    const Checkpoint checkpoint = run.checkpoint();
    CHECK(recalled(checkpoint, "one") == "a longer value than the first");
    CHECK(recalled(checkpoint, "two") == std::string(100000, 'x'));
    CHECK(recalled(checkpoint, "three") == "none");
    CHECK(recalled(run.checkpoint("cd"), "one") == "none");
}

TEST_CASE("a checkpoint with a right hash but damaged values is begun anew", "[apps][checkpoint]") {
    Run run;
    Checkpoint checkpoint = run.checkpoint();
    keep(checkpoint, "one", "first");
    const std::filesystem::path file = run.folder.file("checkpoint.bin");
    const std::string whole = apps::read_whole_file(file);
    const std::string cut = whole.substr(64, whole.size() - 64 - 3);
    write_text(file, apps::sha256(cut) + cut);
    CHECK(recalled(checkpoint, "one") == "none");
    keep(checkpoint, "two", "second");
    CHECK(recalled(checkpoint, "two") == "second");
    CHECK(recalled(checkpoint, "one") == "none");
}

}  // namespace orbid::tests::checkpoint_test
