#include <cstdlib>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/job/job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/report/report_page.hpp"
#include "apps/report/run_comparison.hpp"
#include "apps/results/branch_file.hpp"
#include "apps/results/cycle_reader.hpp"
#include "apps/results/orbit_file.hpp"
#include "apps/stored_run/stored_run.hpp"
#include "orbits/records/data_error.hpp"
#include "tests/fuzz/target.hpp"

namespace orbid::fuzz {

namespace {

namespace fs = std::filesystem;

void job(std::string_view bytes) {
    (void)apps::read_job(bytes, "/nonexistent/job.json");
}

void cycles(std::string_view bytes) {
    (void)apps::parse_cycles(bytes, "henon", {{"x", "1", false}, {"y", "1", true}});
}

void orbits(std::string_view bytes) {
    (void)apps::stored_orbits(bytes);
    (void)apps::stored_branches(bytes);
}

/// Behind the checksum, which only tells what a disk lost.
template <class Value>
void archived(std::string_view bytes) {
    try {
        Value value{};
        apps::Archive archive(bytes);
        archive(value);
    } catch (const apps::DamagedCheckpoint&) {
    }
}

/// Names and values, one after the other until the end.
void named_texts(std::string_view bytes) {
    try {
        for (apps::Archive archive(bytes); !archive.at_end();)
            if (archive.text().size() > bytes.size()) std::abort();
    } catch (const apps::DamagedCheckpoint&) {
    }
}

void checkpoint(std::string_view bytes) {
    if (bytes.empty()) return;
    const auto kind = static_cast<unsigned char>(bytes.front()) % 4;
    bytes.remove_prefix(1);
    if (kind == 0) named_texts(bytes);
    if (kind == 1) archived<estimator::Estimate>(bytes);
    if (kind == 2) archived<std::vector<estimator::BlockValue>>(bytes);
    if (kind == 3) archived<std::vector<orbits::Cycle>>(bytes);
}

/// A stored folder: the first line names the file that is put into it beside a job.
void stored(std::string_view bytes) {
    static constexpr std::string_view job =
        R"({"format": "orbid-job/1", "title": "t", "model": {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}},)"
        R"( "seed": 1, "versions": {"orbid": "0.1.0"}, "data": {"name": "run", "simulate": {"sections": 20,)"
        R"( "initial": [[0.1, 0.1]]}}, "estimate": {"parameters": {"a": {"start": 1.4}}, "residuals": []}})";
    const fs::path folder = place() / "run";
    fs::create_directories(folder);
    for (const char* name :
         {"result.json", "cycles.json", "orbits.json", "branch.json", "residuals.csv", "posterior.csv"})
        fs::remove(folder / name);
    written("run/job.json", job);
    const std::string_view name = bytes.substr(0, bytes.find('\n'));
    bytes.remove_prefix(std::min(name.size() + 1, bytes.size()));
    for (const char* known :
         {"result.json", "cycles.json", "orbits.json", "branch.json", "residuals.csv", "posterior.csv"})
        if (name == known) written(std::string("run/") + known, bytes);
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

std::vector<Target> document_targets() {
    return {{"job", job}, {"cycles", cycles}, {"orbits", orbits}, {"checkpoint", checkpoint}, {"stored", stored}};
}

}  // namespace orbid::fuzz
