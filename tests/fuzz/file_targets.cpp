#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/report/report_page.hpp"
#include "apps/report/run_comparison.hpp"
#include "apps/stored_run/stored_run.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/series_file.hpp"
#include "tests/fuzz/target.hpp"

namespace orbid::fuzz {

namespace {

namespace fs = std::filesystem;

/// A folder of this process in memory.
const fs::path& place() {
    static const fs::path folder = [] {
        const fs::path root = fs::is_directory("/dev/shm") ? fs::path("/dev/shm") : fs::temp_directory_path();
        fs::path made = root / fmt::format("orbid-fuzz-{}", ::getpid());
        fs::create_directories(made);
        std::atexit([] { fs::remove_all(place()); });
        return made;
    }();
    return folder;
}

fs::path written(const char* name, std::string_view bytes) {
    fs::path file = place() / name;
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
    return file;
}

void csv(std::string_view bytes) {
    orbits::TableLayout layout;
    layout.sampling = orbits::Series::Sampling::samples;
    layout.time = "t";
    layout.coordinates = {{{"x", "m", false}, "x", "m", 1.0, 0.0, {}}, {{"phi", "rad", true}, "phi", "deg", -1.0, 0.5, "sd"}};
    const fs::path file = written("table.csv", bytes);
    for (const bool segmented : {false, true}) {
        layout.segment = segmented ? "segment" : "";
        layout.nan_is_missing = segmented;
        layout.coordinates[1].sd = segmented ? "sd" : "";
        try {
            (void)orbits::read_csv(file, layout);
        } catch (const orbits::DataError&) {
        }
    }
}

void hdf5(std::string_view bytes) {
    try {
        (void)orbits::read_hdf5(written("series.h5", bytes));
    } catch (const orbits::DataError&) {
    }
}

/// A stored folder: the first line names the file that is put into it beside a job.
void stored(std::string_view bytes) {
    static constexpr std::string_view job =
        R"({"format": "orbid-job/1", "title": "t", "model": {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}},)"
        R"( "seed": 1, "versions": {"orbid": "0.1.0"}, "data": {"name": "run", "simulate": {"sections": 20,)"
        R"( "initial": [[0.1, 0.1]]}}, "estimate": {"parameters": {"a": {"start": 1.4}}, "residuals": []}})";
    const fs::path folder = place() / "run";
    fs::create_directories(folder);
    for (const char* name : {"result.json", "cycles.json", "orbits.json", "branch.json", "residuals.csv", "posterior.csv"})
        fs::remove(folder / name);
    written("run/job.json", job);
    const std::string_view name = bytes.substr(0, bytes.find('\n'));
    bytes.remove_prefix(std::min(name.size() + 1, bytes.size()));
    for (const char* known : {"result.json", "cycles.json", "orbits.json", "branch.json", "residuals.csv", "posterior.csv"})
        if (name == known) written((std::string("run/") + known).c_str(), bytes);
    // As the commands report, plot and compare refuse.
    try {
        const apps::StoredRun run = apps::read_stored_run(folder);
        (void)apps::report_html(run);
        (void)apps::comparison_text(run, run);
    } catch (const orbits::DataError&) {
    } catch (const apps::StoredRunRefused&) {
    } catch (const apps::FileUnreadable&) {
    } catch (const nlohmann::json::exception&) {
    }
}

}  // namespace

std::vector<Target> file_targets() {
    return {{"csv", csv}, {"hdf5", hdf5}, {"stored", stored}};
}

}  // namespace orbid::fuzz
