#include "apps/program/check/work_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/evaluated_model.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/program/check/job_amounts.hpp"
#include "apps/results/counted_noun.hpp"
#include "apps/stages/orbits_stage.hpp"

namespace orbid::apps {

namespace {

// Rates of one core, measured on the jobs in configs/ (four cores of a shared machine, 2.5 GHz or so).
constexpr double seconds_per_byte = 1e-8;  // reading a table
constexpr double least_report = 0.1;       // files and their page, the start of the program included
constexpr double seconds_per_reading = 1e-5;
constexpr double compilation = 10.0;
constexpr double clean_search = 3e-6;      // a point of a section, cycles by local maps
constexpr double noisy_search = 1.1e-3;    // a point, cycles by one map fitted to all
constexpr double search_per_period = 0.1;  // solving and fitting what was found
constexpr double branch_orbits = 300.0;    // on the way and along a branch, held at once
constexpr double waveform_orbits = 0.5;    // turns followed per evaluation: most orbits close again at once
constexpr double samples_per_crossing = 50.0;
constexpr double cycles_per_period = 30.0;  // that a search of a chaotic series comes to
// Evaluations with derivatives until a minimisation has ended, its start and its uncertainties included.
constexpr double cycle_sweeps = 100.0;
constexpr double series_sweeps = 40.0;
constexpr double started_sweeps = 80.0;          // from other starts than the given one
constexpr double prediction_intervals = 2000.0;  // more are thinned out
constexpr double posterior_steps = 7.0;          // gradients per draw
constexpr double profile_sweeps = 100.0;         // per unknown: some twenty minimisations from near by
constexpr double replicate_sweeps = 12.0;        // estimates that begin at the estimate
constexpr double bytes = sizeof(double), megabyte = 1e6;
// What a search holds at once over what the series takes (docs/orbits.md).
constexpr double search_copies = 3.0;
// One map is fitted to all data of this many points and fewer (CycleSearchOptions::Method::automatic).
constexpr double most_noisy_points = 262144.0;
// The equations of one map fitted to all data: 3 x 8 bytes x 3600^2 for cells of 2 % over the pendulum's attractor.
constexpr double noisy_search_bytes = 3e8;

/// What the numbers of a job come to; one object per call.
class Estimator {
public:
    Estimator(const Job& job, const DataCheck& data, int threads, const std::vector<FlowRate>& rates)
        : job_(job),
          data_(data),
          amounts_(job, data, rates),
          threads_(static_cast<double>(threads)),
          n_(static_cast<double>(job.model.system->dimension())) {}

    std::vector<StageWork> all() {
        if (is_compiled_first(job_)) add("compile", "the equations", 0.0, compilation);
        for (std::size_t i = 0; i < job_.data.size(); ++i)
            job_.data[i].file ? reading(i) : simulation(i);
        // What is run if needed need not be run.
        if (job_.orbits && !job_.orbits->file && !are_cycles_optional(job_)) {
            const double seconds = search_seconds();
            const DataJob& data = job_.data[job_.orbits->data];
            double memory = search_copies * amounts_.points(job_.orbits->data) * n_ * bytes;
            if (data.streamed()) memory = std::min(memory, megabyte * data.file->stream_memory);
            if (!is_clean(data) && amounts_.points(job_.orbits->data) <= most_noisy_points)
                memory += noisy_search_bytes;
            add("orbits", fmt::format("{:.0f} points, periods {}", amounts_.points(job_.orbits->data), periods_text()),
                memory, seconds);
        }
        if (job_.periodic) periodic();
        if (job_.estimate) estimate();
        const double written = job_.estimate ? readings() : 0.0;
        add("report", "", 0.0, least_report + written * seconds_per_reading);
        return std::move(work_);
    }

private:
    void add(std::string stage, std::string amount, double memory, double seconds) {
        work_.push_back({std::move(stage), std::move(amount), memory / megabyte, seconds});
    }

    void add_unknown(std::string stage, std::string amount, double memory, std::string reason) {
        work_.push_back({std::move(stage), std::move(amount), memory / megabyte,
                         std::numeric_limits<double>::quiet_NaN(), std::move(reason)});
    }

    [[nodiscard]] std::string periods_text() const {
        return fmt::format("{}", fmt::join(job_.orbits->search.periods, ", "));
    }

    void reading(std::size_t index) {
        const auto size = job_.data[index].file->bytes();
        const std::size_t segments = amounts_.segments(index);
        add("read",
            fmt::format("{:.0f} points in {} segment{}", amounts_.points(index), segments, segments == 1 ? "" : "s"),
            job_.data[index].streamed() ? 0.0 : amounts_.points(index) * n_ * bytes, size * seconds_per_byte);
    }

    void simulation(std::size_t index) {
        const SimulationJob& run = *job_.data[index].simulation;
        const auto trajectories = static_cast<double>(run.trajectories);
        const double left_out = trajectories * static_cast<double>(run.transient);
        const double cores = std::min(threads_, trajectories);
        add("simulate",
            fmt::format("{} on {}", counted(static_cast<std::size_t>(amounts_.points(index)), "point"),
                        counted(run.trajectories, "trajectory")),
            amounts_.points(index) * n_ * bytes, (amounts_.points(index) + left_out) * amounts_.step(index) / cores);
    }

    /// Whether readings are known to have no errors: local maps then do, which are fast.
    [[nodiscard]] bool is_clean(const DataJob& data) const {
        const bool noise = !data.simulation || (data.simulation->noise.array() > 0.0).any();
        return !noise && data.sensor.type == models::Sensor::Type::state;
    }

    [[nodiscard]] double search_seconds() const {
        const DataJob& data = job_.data[job_.orbits->data];
        const auto periods = static_cast<double>(job_.orbits->search.periods.size());
        // Samples are cut: a motion crosses a plane, or its phase returns, once in so many.
        const bool cut = data.sampling() == orbits::Series::Sampling::samples;
        const double searched = amounts_.points(job_.orbits->data) / (cut ? samples_per_crossing : 1.0);
        const double point = is_clean(data) || searched > most_noisy_points ? clean_search : noisy_search;
        return (searched * point + periods * search_per_period) / threads_;
    }

    void periodic() {
        const PeriodicJob& periodic = *job_.periodic;
        const double crossing = amounts_.crossing();
        const double orbit = crossing * (1.0 + n_) * cycle_sweeps;  // per point of an orbit
        double starts = 0.0;
        for (const OrbitStart& start : periodic.orbits)
            starts += static_cast<double>(start.period);
        if (!periodic.orbits.empty())
            add("periodic", fmt::format("{} orbit{}", periodic.orbits.size(), periodic.orbits.size() == 1 ? "" : "s"),
                0.0, starts * orbit / threads_);
        if (periodic.search) {
            const auto count = static_cast<double>(periodic.search->points);
            double found = 0.0;
            for (const int period : periodic.search->periods)
                found += cycles_per_period * period;
            add("search", fmt::format("{:.0f} points, periods {}", count, fmt::join(periodic.search->periods, ", ")),
                search_copies * count * n_ * bytes, (count * crossing + found * orbit) / threads_);
        }
        if (periodic.continuation) {
            const auto& options = periodic.continuation->options;
            const double most =
                static_cast<double>(options.maximum_branches) * static_cast<double>(options.maximum_points);
            add_unknown("branches", fmt::format("at most {:.0f} orbits", most),
                        most * static_cast<double>(options.maximum_period) * n_ * (n_ + 1.0) * bytes,
                        "where a branch ends, and which others begin on it, is found by following it");
        }
    }

    /// Seconds of one evaluation of a stage's residuals with derivatives.
    [[nodiscard]] double sweep(const StageJob& stage) const {
        const EstimateJob& estimate = *job_.estimate;
        double seconds = 0.0;
        if (stage.uses(ResidualType::cycles))
            seconds += cycle_points() * amounts_.crossing() * amounts_.directions() / threads_;
        if (stage.uses(ResidualType::series) && estimate.series)
            for (const std::size_t index : estimate.series->data) {
                // Segments are followed beside each other; intervals as well, several to a core.
                const double cores = estimate.series->interval
                                         ? 2.0 * threads_
                                         : std::clamp(amounts_.fitted_segments(index), 1.0, threads_);
                seconds += amounts_.fitted_points(index) * amounts_.derivative_step(index) / cores;
            }
        if (stage.uses(ResidualType::waveform) && estimate.waveform)
            for (const std::size_t index : estimate.waveform->data)
                seconds +=
                    waveform_orbits * amounts_.waveform_points(index) * amounts_.derivative_step(index) / threads_;
        return seconds;
    }

    /// Why its time is not known; empty: it is.
    [[nodiscard]] std::string obstacle(const StageJob& stage) const {
        const EstimateJob& estimate = *job_.estimate;
        if (stage.uses(ResidualType::branch)) return "the branch is followed anew at every step, as far as it leads";
        if (stage.uses(ResidualType::series) && estimate.series)
            if (std::string why = amounts_.obstacle(estimate.series->data); !why.empty()) return why;
        if (stage.uses(ResidualType::waveform) && estimate.waveform) return amounts_.obstacle(estimate.waveform->data);
        return {};
    }

    /// Points of all cycles: known from a file, supposed of a search.
    [[nodiscard]] double cycle_points() const {
        if (!job_.orbits || !job_.estimate->cycles) return 0.0;
        const auto& periods = job_.estimate->cycles->periods;
        double sum = 0.0;
        for (const int period : periods)
            sum += period;
        if (data_.cycles && !periods.empty())
            return static_cast<double>(*data_.cycles) * sum / static_cast<double>(periods.size());
        return cycles_per_period * sum;
    }

    [[nodiscard]] double readings() const {
        const EstimateJob& estimate = *job_.estimate;
        double count = 0.0;
        const auto add_records = [&](const std::vector<std::size_t>& data) {
            for (const std::size_t index : data)
                count += amounts_.fitted_points(index) * static_cast<double>(job_.data[index].observe.size());
        };
        if (estimate.series) add_records(estimate.series->data);
        if (estimate.waveform) add_records(estimate.waveform->data);
        return count;
    }

    void estimate() {
        const EstimateJob& estimate = *job_.estimate;
        const auto free = static_cast<double>(estimate.parameters.size());
        double last = 0.0;
        for (const StageJob& stage : estimate.strategy) {
            if (stage.if_needed) continue;
            if (stage.kind == StageJob::Kind::prediction) {
                double seconds = 0.0;
                for (std::size_t i = 0; i < job_.data.size(); ++i)
                    seconds += std::min(amounts_.points(i), prediction_intervals) * amounts_.derivative_step(i);
                add(stage.name(), counted(estimate.parameters.size(), "parameter"), 0.0,
                    seconds * series_sweeps / threads_);
                continue;
            }
            const bool nodes = stage.uses(ResidualType::series) && estimate.series && estimate.series->interval;
            const double cycles = stage.uses(ResidualType::cycles) ? cycle_points() : 0.0;
            const double read = stage.uses(ResidualType::series) || stage.uses(ResidualType::waveform) ? readings() : 0;
            std::string amount = counted(estimate.parameters.size(), "parameter");
            if (cycles > 0.0) amount += fmt::format(", {}{:.0f} points of cycles", data_.cycles ? "" : "some ", cycles);
            if (read > 0.0) amount += fmt::format(", {:.0f} readings", read);
            if (nodes) amount += ", states at nodes";
            last = sweep(stage);
            double seconds = last * (cycles > 0.0 ? cycle_sweeps : series_sweeps);
            if (stage.kind == StageJob::Kind::harvest) seconds += 2.0 * search_seconds();
            // Residuals with their derivatives after parameters and the two states at the ends of an interval, and
            // the factors of their normal equations.
            const double followed = stage.uses(ResidualType::branch) ? branch_orbits : 0.0;
            const double memory = 4.0 * ((cycles + followed) * n_ + read) * (free + 2.0 * n_) * bytes;
            const std::string name = estimate.strategy.size() > 1 ? stage.name() : "estimate";
            unknown_ = obstacle(stage);
            if (unknown_.empty())
                add(name, amount, memory, seconds);
            else
                add_unknown(name, amount, memory, unknown_);
        }
        exploration(last, free);
    }

    /// What is asked for beside the estimate; `sweep` seconds per evaluation.
    void exploration(double sweep, double free) {
        const EstimateJob& estimate = *job_.estimate;
        // What is not known of an evaluation is not known of many.
        const auto add = [this](std::string stage, std::string amount, double memory, double seconds) {
            if (unknown_.empty())
                this->add(std::move(stage), std::move(amount), memory, seconds);
            else
                add_unknown(std::move(stage), std::move(amount), memory, unknown_);
        };
        const auto unknowns = [free](const ParameterChoice& choice) {
            return choice.all ? free + 1.0 : static_cast<double>(choice.names.size());
        };
        if (estimate.multi_start.starts > 1) {
            const auto starts = static_cast<double>(estimate.multi_start.starts);
            add("starts", fmt::format("{} starts", estimate.multi_start.starts), 0.0, starts * sweep * started_sweeps);
        }
        const CriticismJob& criticism = estimate.criticism;
        if (criticism.any()) {
            const auto models = static_cast<double>(criticism.variants.size() + criticism.without.size()) + 1.0;
            const double folds = criticism.held_out > 0.0 ? 1.0 + 1.0 / criticism.held_out : 1.0;
            add("criticism", fmt::format("{:.0f} models", models), 0.0, models * folds * sweep * 2.0 * series_sweeps);
        }
        if (estimate.profile.any()) {
            const double count = unknowns(estimate.profile);
            add("profile", fmt::format("{:.0f} unknowns", count), 0.0, count * sweep * profile_sweeps);
        }
        if (estimate.marginals.any()) {
            const double count = unknowns(estimate.marginals);
            add("marginals", fmt::format("{:.0f} unknowns", count), 0.0, count * sweep * profile_sweeps);
        }
        if (estimate.intervals.bootstrap > 0) {
            const auto count = static_cast<double>(estimate.intervals.bootstrap);
            add("intervals", fmt::format("{:.0f} replicates", count), count * free * 2.0 * bytes,
                count * sweep * replicate_sweeps);
        }
        if (estimate.sample.draws > 0) {
            const auto chains = static_cast<double>(estimate.sample.chains);
            const double iterations = chains * static_cast<double>(estimate.sample.draws + estimate.sample.warm_up);
            const double draws = chains * static_cast<double>(estimate.sample.draws);
            // Small evaluations run on one core each, chains beside each other: as many cores, differently shared.
            add("posterior", fmt::format("{:.0f} iterations in {} chains", iterations, estimate.sample.chains),
                draws * (free + readings()) * bytes, iterations * posterior_steps * sweep);
        }
    }

    const Job& job_;
    const DataCheck& data_;
    JobAmounts amounts_;
    double threads_;
    double n_;
    std::string unknown_;  ///< of the last stage of the estimate
    std::vector<StageWork> work_;
};

}  // namespace

std::vector<StageWork> estimated_work(const Job& job, const DataCheck& data, int threads,
                                      const std::vector<FlowRate>& rates) {
    return Estimator(job, data, threads, rates).all();
}

}  // namespace orbid::apps
