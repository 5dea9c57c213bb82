// The jobs of the paper's tables I to III on 2^16 sections (the jobs themselves ask for 2^20) against the deviations
// printed there.

#include <cmath>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/program/run.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace paper_tables_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

/// The job's result on 2^16 sections.
json result_of(const std::string& name) {
    const auto reading = apps::read_job_file(Path(orbid::tests::source_folder()) / "configs" / name);
    REQUIRE(reading.job);
    apps::Job job = *reading.job;
    REQUIRE(job.data.at(0).simulation);
    CHECK(job.data[0].simulation->sections == 1048576);
    job.data[0].simulation->sections = 65536;
    const TemporaryFolder folder;
    apps::RunOptions options;
    options.out = folder.path() / "out";
    options.quiet = true;
    {
        const TemporaryFolder printed;
        const CaughtStream out(STDOUT_FILENO, printed.path() / "out");
        REQUIRE(apps::run_job(job, options, apps::standard_console()) == 0);
    }
    return read_json(options.out / "result.json");
}

/// What the result says about a quantity of the table: k2/m and k3/m are derived quantities of the jobs.
const json& estimate_of(const json& result, std::string name) {
    if (const auto slash = name.find('/'); slash != std::string::npos) name.replace(slash, 1, "_over_");
    return result["parameters"].contains(name) ? result["parameters"][name] : result["derived"][name];
}

json paper_tables() {
    return read_json(Path(orbid::tests::source_folder()) / "tests" / "reference" / "paper_tables.json");
}

}  // namespace

TEST_CASE("the paper's tables are met with a sixteenth of its data", "[apps][paper]") {
    const json tables = paper_tables();
    for (int number = 1; number <= 3; ++number) {
        const json& table = tables[std::string(static_cast<std::size_t>(number), 'I')];
        CAPTURE(number);
        const json result = result_of(fmt::format("pendulum_table{}.json", number));
        int compared = 0;
        for (const auto& [name, deviation] : table["final_deviation_percent"].items()) {
            CAPTURE(name);
            const json& ours = estimate_of(result, name);
            REQUIRE(ours.is_object());
            const double start = ours["start"].get<double>() / ours["reference"].get<double>() - 1.0;
            // The start stands in the job with three to four digits, in the table with one decimal of a percent.
            CHECK_THAT(100.0 * std::abs(start), WithinAbs(table["start_deviation_percent"][name].get<double>(), 0.051));
            // 0.0 % is printed for anything below 0.05 %.
            const double printed = deviation.get<double>() > 0.0 ? deviation.get<double>() : 0.05;
            const double ours_percent = 100.0 * std::abs(ours["relative_deviation"].get<double>());
            CHECK(ours_percent < printed);
            CHECK(std::abs(ours["relative_deviation"].get<double>() * ours["reference"].get<double>()) <
                  4.0 * ours["sd"].get<double>());
            ++compared;
        }
        CHECK(compared == (number == 3 ? 3 : 2));
    }
}

TEST_CASE("the paper's own analysis comes within the deviations that it prints", "[apps][paper]") {
    const json table = paper_tables()["III"];
    const json result = result_of("pendulum_table3_paper_method.json");
    int compared = 0;
    for (const auto& [name, deviation] : table["final_deviation_percent"].items()) {
        CAPTURE(name);
        const json& ours = estimate_of(result, name);
        REQUIRE(ours.is_object());
        // Three times what is printed, 0.15 % for the 0.0 % that stands for anything below 0.05 %. Measured with this
        // sixteenth of the data, three seeds: 0.011 %, 1.7 % and 0.36 % at worst, a tenth of what is allowed.
        const double allowed = deviation.get<double>() > 0.0 ? 3.0 * deviation.get<double>() : 0.15;
        CHECK(100.0 * std::abs(ours["relative_deviation"].get<double>()) < allowed);
        ++compared;
    }
    CHECK(compared == 3);
    // With equal weights the scale of the errors is a sd in the coordinate's own unit.
    CHECK(result["errors"]["cycles.phi"]["unit"] == "rad");
    CHECK(result["errors"]["cycles.phi_dot"]["unit"] == "rad/s");
}

}  // namespace paper_tables_test
