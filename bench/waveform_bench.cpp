// A job of simulated steady states made again and again with other errors: how often intervals of 95 % hold the truth,
// and how large error scales and correlations come out.
//   waveform_bench [replicates, default 50] [job, default configs/landing_gear_waveform.json] [variance, as in jobs]
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <numbers>
#include <string>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/atomic_file.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/program/run.hpp"

namespace {

using namespace orbid;
using nlohmann::json;

/// How estimates of one number lie about its true value.
struct Coverage {
    double truth = 0.0;
    int covered = 0;
    double sum = 0.0;         ///< of estimates
    double deviations = 0.0;  ///< sum of (value - truth) / sd
    double squares = 0.0;

    void add(double value, double sd, const json& interval) {
        if (interval.is_array() && interval[0].get<double>() <= truth && truth <= interval[1].get<double>()) ++covered;
        sum += value;
        deviations += (value - truth) / sd;
        squares += (value - truth) / sd * ((value - truth) / sd);
    }
};

/// Silences the tables that a run prints.
class Silence {
public:
    Silence() : former_(::dup(STDOUT_FILENO)) {
        std::fflush(stdout);
        const int nowhere = ::open("/dev/null", O_WRONLY);
        ::dup2(nowhere, STDOUT_FILENO);
        ::close(nowhere);
    }
    ~Silence() {
        std::fflush(stdout);
        ::dup2(former_, STDOUT_FILENO);
        ::close(former_);
    }
    Silence(const Silence&) = delete;
    Silence& operator=(const Silence&) = delete;

private:
    int former_;
};

}  // namespace

int main(int count, char** arguments) {
    const int replicates = count > 1 ? std::atoi(arguments[1]) : 50;
    const std::string file = count > 2 ? arguments[2] : ORBID_SOURCE_DIR "/configs/landing_gear_waveform.json";
    const auto reading = apps::read_job_file(std::filesystem::absolute(file));
    if (!reading.job || !reading.job->estimate || !reading.job->estimate->waveform || replicates < 1) {
        fmt::print(stderr, "needs a number of replicates and a job that estimates from waveforms\n");
        return 2;
    }
    apps::Job job = *reading.job;
    job.series_output = apps::SeriesOutput::none;
    if (count > 3) {
        const std::string variance = arguments[3];
        job.estimate->variance = variance == "ml" ? estimator::Variance::ml : estimator::Variance::restricted;
    }
    std::map<std::string, Coverage> coverages;
    for (const apps::ReferenceJob& reference : job.reference)
        coverages[reference.name].truth = reference.value;
    const auto& simulation = *job.data[job.estimate->waveform->data.front()].simulation;
    const auto coordinates = job.model.system->coordinates();
    for (const apps::ErrorJob& error : job.estimate->waveform->errors) {
        const auto name = std::string(coordinates[static_cast<std::size_t>(error.coordinate)].name);
        coverages["waveform." + name + " sd"].truth = simulation.noise[error.coordinate];
        coverages["waveform." + name + " correlation"].truth = simulation.noise_correlation[error.coordinate];
    }

    const auto folder = std::filesystem::temp_directory_path() / fmt::format("orbid_waveform_bench_{}", ::getpid());
    int converged = 0, used = 0;
    double phase_squares = 0.0;
    int phases = 0, phases_covered = 0;
    for (int r = 1; r <= replicates; ++r) {
        job.seed = static_cast<std::uint64_t>(r);
        apps::RunOptions options;
        options.out = folder;
        options.quiet = true;
        options.force = true;
        {
            const Silence silence;
            (void)apps::run_job(job, options, apps::standard_console());
        }
        const json result = json::parse(apps::read_whole_file(folder / "result.json"));
        if (result["status"] != "converged") continue;
        ++converged;
        used += result["residuals"][0]["used"].get<int>();
        for (auto& [name, coverage] : coverages) {
            if (result["parameters"].contains(name)) {
                const json& parameter = result["parameters"][name];
                coverage.add(parameter["value"], parameter["sd"], parameter["interval95"]);
            }
        }
        for (const auto& [group, errors] : result["errors"].items()) {
            coverages[group + " sd"].add(errors["sd"], errors["uncertainty"], errors["interval95"]);
            if (!errors.contains("correlation")) continue;
            const json& correlation = errors["correlation"];
            coverages[group + " correlation"].add(correlation["value"], correlation["uncertainty"],
                                                  correlation["interval95"]);
        }
        for (const json& state : result["steady_states"]) {
            if (!state["phase"]["sd"].is_number()) continue;
            // Simulated with the forcing at the section's phase at time 0.
            const double u =
                std::remainder(state["phase"]["value"].get<double>() - job.section_phase, 2.0 * std::numbers::pi) /
                state["phase"]["sd"].get<double>();
            phase_squares += u * u;
            ++phases;
            if (std::abs(u) < 1.96) ++phases_covered;
        }
    }
    std::filesystem::remove_all(folder);

    fmt::print("{} of {} replicates converged, {:.2f} records used in the mean\n", converged, replicates,
               static_cast<double>(used) / std::max(converged, 1));
    fmt::print("{:<30} {:>8} {:>12} {:>14} {:>22}\n", "", "covered", "truth", "mean / truth",
               "deviation: mean, rms sds");
    for (const auto& [name, coverage] : coverages) {
        fmt::print("{:<30} {:>8} {:>12.6g} {:>14.4f} {:>+12.2f} {:>9.2f}\n", name, coverage.covered, coverage.truth,
                   coverage.sum / converged / coverage.truth, coverage.deviations / converged,
                   std::sqrt(coverage.squares / converged));
    }
    fmt::print("phases: {} of {} within 1.96 sds, rms {:.2f} sds\n", phases_covered, phases,
               std::sqrt(phase_squares / std::max(phases, 1)));
    return 0;
}
