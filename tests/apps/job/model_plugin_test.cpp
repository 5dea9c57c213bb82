#include "apps/job/model_plugin.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "apps/documents/atomic_file.hpp"
#include "apps/job/compiler_run.hpp"
#include "models/equations/interpreted_kernel.hpp"
#include "models/system/kernel_system.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace model_plugin_test {

using namespace orbid;
using tests::ContainsSubstring;
namespace fs = std::filesystem;

namespace {

/// A variable of the environment while it lives.
class Variable {
public:
    Variable(const char* name, const std::string& value) : name_(name) {
        if (const char* before = std::getenv(name)) before_ = before;
        ::setenv(name, value.c_str(), 1);
    }
    ~Variable() {
        if (before_)
            ::setenv(name_, before_->c_str(), 1);
        else
            ::unsetenv(name_);
    }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;

private:
    const char* name_;
    std::optional<std::string> before_;
};

/// A map: the shape that compiles fastest.
std::shared_ptr<const models::Equations> henon(double number = 1.0) {
    models::EquationText text;
    text.map = true;
    text.coordinates = {{"x", std::to_string(number) + " - a * x^2 + y", "1", false}, {"y", "b * x", "1", false}};
    text.parameters = {{"a", "1", models::any_real, 1.4}, {"b", "1", models::any_real, 0.3}};
    std::vector<models::EquationProblem> problems;
    auto equations = models::Equations::read(text, problems);
    REQUIRE(equations);
    return equations;
}

bool no_compiler() {
    if (apps::find_compiler()) return false;
    WARN("skipped: no C++ compiler was found");
    return true;
}

std::vector<fs::path> files_in(const fs::path& folder) {
    std::vector<fs::path> files;
    if (fs::exists(folder))
        for (const auto& entry : fs::recursive_directory_iterator(folder))
            files.push_back(entry.path());
    return files;
}

}  // namespace

TEST_CASE("compiled equations are kept, found again, and replaced when broken", "[apps][plugin]") {
    if (no_compiler()) return;
    const tests::TemporaryFolder folder;
    const Variable cache("XDG_CACHE_HOME", folder.path());
    const auto equations = henon();
    CHECK_FALSE(apps::compiled_model_state(*equations).cached);
    // Two at once, as two programs would.
    auto other = std::async(std::launch::async, [&] { return apps::compiled_model(equations); });
    const apps::CompiledModel first = apps::compiled_model(equations);
    const apps::CompiledModel beside = other.get();
    INFO(first.why << beside.why);
    REQUIRE(first.kernel);
    REQUIRE(beside.kernel);
    CHECK_FALSE(first.cached);
    // One file, that nobody else can write, and nothing left beside it.
    const auto files = files_in(folder.path() / "orbid");
    REQUIRE(files.size() == 1);
    CHECK((fs::status(files[0]).permissions() & fs::perms::all) == (fs::perms::owner_read | fs::perms::owner_write));
    CHECK(apps::compiled_model_state(*equations).cached);
    const apps::CompiledModel again = apps::compiled_model(equations);
    CHECK(again.cached);
    // The same bits as interpreted, iterate by iterate.
    std::string why;
    const models::KernelSystem of_compiled(again.kernel), of_interpreted(models::interpreted_kernel(equations, why));
    const models::System &compiled = of_compiled, &interpreted = of_interpreted;
    const std::vector<double> durations{1.0, 2.0, 30.0};
    const std::vector<Eigen::Index> free{0, 1};
    const Eigen::Vector2d x0(0.1, 0.2);
    const auto theta = compiled.default_parameters();
    const auto a = compiled.flow_with_sensitivities(x0, 0.0, durations, theta, free, models::Clock::time);
    const auto b = interpreted.flow_with_sensitivities(x0, 0.0, durations, theta, free, models::Clock::time);
    CHECK(a.states == b.states);
    CHECK(a.sensitivities == b.sensitivities);
    CHECK(compiled.name() == "equations");
    CHECK(compiled.coordinates()[1].name == "y");

    // A file that lost its end, or has a wrong byte, is not loaded but made anew. A new file takes its name: cutting
    // the one that is loaded here would be a bus error.
    const std::string whole = apps::read_whole_file(files[0]);
    const fs::path damaged = folder.path() / "damaged";
    std::ofstream(damaged, std::ios::binary) << whole.substr(0, whole.size() / 2);
    fs::rename(damaged, files[0]);
    CHECK_FALSE(apps::compiled_model_state(*equations).cached);
    const apps::CompiledModel repaired = apps::compiled_model(equations);
    CHECK(repaired.kernel);
    CHECK_FALSE(repaired.cached);
    CHECK(apps::compiled_model_state(*equations).cached);
}

TEST_CASE("without a compiler, headers or a cache equations stay interpreted, and it is said why", "[apps][plugin]") {
    const tests::TemporaryFolder folder;
    const Variable cache("XDG_CACHE_HOME", folder.path());
    {
        const Variable none("ORBID_CXX", "");
        const auto model = apps::compiled_model(henon());
        CHECK_FALSE(model.kernel);
        CHECK_THAT(model.why, ContainsSubstring("no C++ compiler"));
    }
    {
        const Variable wrong("ORBID_CXX", "/bin/false");
        const auto model = apps::compiled_model(henon());
        CHECK_FALSE(model.kernel);
        CHECK_THAT(model.why, ContainsSubstring("/bin/false failed"));
        CHECK(files_in(folder.path() / "orbid").empty());  // nothing is left of the attempt
    }
    if (no_compiler()) return;
    {
        // A folder that others may write to.
        ::chmod((folder.path() / "orbid").c_str(), 0777);
        const auto model = apps::compiled_model(henon());
        CHECK_FALSE(model.kernel);
        CHECK_THAT(model.why, ContainsSubstring("only you can write to"));
    }
    {
        // A file in the place of the folder: nothing can be written, by nobody.
        const Variable file("XDG_CACHE_HOME", tests::write_text(folder.path() / "file", "").string());
        const auto model = apps::compiled_model(henon());
        CHECK_FALSE(model.kernel);
        CHECK_THAT(model.why, ContainsSubstring("cannot be made"));
    }
}

TEST_CASE("programs are run without a shell", "[apps][plugin]") {
    const tests::TemporaryFolder folder;
    const fs::path printed = folder.path() / "printed";
    const auto end = apps::run_program("/bin/echo", {"$(touch bad); `id`", "a b"}, printed, folder.path(), 10.0);
    CHECK(end.succeeded());
    CHECK(apps::read_whole_file(printed) == "$(touch bad); `id` a b\n");
    CHECK(apps::run_program("/bin/false", {}, printed, folder.path(), 10.0).exit_code == 1);
    CHECK_FALSE(apps::run_program("/bin/no_such_program", {}, printed, folder.path(), 10.0).started);
    const auto slow = apps::run_program("/bin/sleep", {"30"}, printed, folder.path(), 0.2);
    CHECK(slow.timed_out);
    CHECK_FALSE(slow.succeeded());
}

TEST_CASE("a run says that its equations were compiled", "[apps][plugin]") {
    if (no_compiler()) return;
    const tests::TemporaryFolder folder;
    const Variable cache("XDG_CACHE_HOME", folder.path() / "cache");
    const auto job = tests::write_text(folder.path() / "job.json", R"json({
      "model": { "kind": "map", "equations": { "x": "r * x * (1 - x)" }, "parameters": { "r": 3.9 }, "compile": true },
      "data": { "simulate": { "sections": 256, "trajectories": 2, "transient": 10, "initial": [[0.3], [0.4]] } } })json");
    const auto before = tests::orbid_with({"check", job});
    CHECK_THAT(before.out, ContainsSubstring("equations  compiled first"));
    const auto run = tests::orbid_with({"run", job, "--out", folder.path() / "out"});
    CAPTURE(run.error);
    CHECK(run.code == 0);
    CHECK_THAT(run.error, ContainsSubstring("equations compiled"));
    CHECK_THAT(apps::read_whole_file(folder.path() / "out" / "log.txt"), ContainsSubstring("equations compiled"));
    const auto after = tests::orbid_with({"check", job});
    CHECK_THAT(after.out, ContainsSubstring("equations  compiled, in the cache"));
}

}  // namespace model_plugin_test
