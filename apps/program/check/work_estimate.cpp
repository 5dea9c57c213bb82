#include "apps/program/check/work_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/counted_noun.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stages/progress.hpp"

namespace orbid::apps {

namespace {

// Rates of one core, measured on the jobs in configs/ (four cores of a shared machine, 2.5 GHz or so).
constexpr double seconds_per_crossing = 8e-6;  // one coordinate from section to section; maps take a hundredth
constexpr double seconds_per_sample = 1e-6;    // one coordinate over a sampling interval
constexpr double seconds_per_byte = 1e-8;      // reading a table
constexpr double clean_search = 3e-6;          // a point of a section, cycles by local maps
constexpr double noisy_search = 1.5e-3;        // a point, cycles by one map fitted to all
constexpr double search_per_period = 0.1;      // solving and fitting what was found
constexpr double branch_orbits = 300.0;        // solved per evaluation, on the way and along the branch
constexpr double orbit_steps = 10.0;           // of Newton's method and along the orbit, with their derivatives
constexpr double samples_per_crossing = 50.0;
constexpr double cycles_per_period = 30.0;  // that a search of a chaotic series comes to
// Evaluations with derivatives until a minimisation has ended, its start and its uncertainties included.
constexpr double cycle_sweeps = 100.0;
constexpr double series_sweeps = 30.0;
constexpr double prediction_intervals = 4096.0;  // more are thinned out
constexpr double posterior_steps = 10.0;         // gradients per draw
constexpr double profile_sweeps = 100.0;         // per unknown: some twenty minimisations from near by
constexpr double bytes = sizeof(double);
constexpr double megabyte = 1e6;
// What a search holds at once over what the series takes (docs/orbits.md).
constexpr double search_copies = 3.0;
// The equations of one map fitted to all data: 3 x 8 bytes x 3600^2 for cells of 2 % over the pendulum's attractor.
constexpr double noisy_search_bytes = 3e8;

/// What the numbers of a job come to; one object per call.
class Estimator {
public:
    Estimator(const Job& job, const DataCheck& data, int threads)
        : job_(job),
          data_(data),
          threads_(static_cast<double>(threads)),
          n_(static_cast<double>(job.model.system->dimension())) {}

    std::vector<StageWork> all() {
        for (std::size_t i = 0; i < job_.data.size(); ++i)
            job_.data[i].file ? reading(i) : simulation(i);
        if (job_.orbits && !job_.orbits->file) {
            const double seconds = search_seconds();
            add("orbits", fmt::format("{:.0f} points, periods {}", points(job_.orbits->data), periods_text()),
                search_copies * points(job_.orbits->data) * n_ * bytes +
                    (is_clean(job_.data[job_.orbits->data]) ? 0.0 : noisy_search_bytes),
                seconds);
        }
        if (job_.periodic) periodic();
        if (job_.estimate) estimate();
        return std::move(work_);
    }

private:
    void add(std::string stage, std::string amount, double memory, double seconds) {
        work_.push_back({std::move(stage), std::move(amount), memory / megabyte, seconds});
    }

    [[nodiscard]] bool is_map() const { return job_.model.system->kind() == models::Kind::map; }

    /// Of an experiment; a section or sample with all its coordinates.
    [[nodiscard]] double points(std::size_t index) const {
        const DataJob& data = job_.data[index];
        if (data.simulation) {
            const SimulationJob& run = *data.simulation;
            return data.sampling() == orbits::Series::Sampling::section
                       ? static_cast<double>(run.sections)
                       : static_cast<double>(run.count) * static_cast<double>(run.trajectories);
        }
        return index < data_.records.size() && data_.records[index] ? static_cast<double>(data_.records[index]->points)
                                                                    : 0.0;
    }

    /// Seconds of one core from one point of an experiment to the next.
    [[nodiscard]] double step(std::size_t index) const {
        if (is_map()) return 0.01 * seconds_per_crossing * n_;
        const bool section = job_.data[index].sampling() == orbits::Series::Sampling::section;
        return (section ? seconds_per_crossing : seconds_per_sample) * n_;
    }

    /// Derivatives after states and parameters beside the value.
    [[nodiscard]] double directions() const { return 1.0 + n_ + static_cast<double>(job_.estimate->parameters.size()); }

    [[nodiscard]] std::string periods_text() const {
        return fmt::format("{}", fmt::join(job_.orbits->search.periods, ", "));
    }

    void reading(std::size_t index) {
        const auto size = job_.data[index].file->bytes();
        const std::size_t segments = data_.records[index] ? data_.records[index]->segments : 0;
        add("read", fmt::format("{:.0f} points in {} segment{}", points(index), segments, segments == 1 ? "" : "s"),
            points(index) * n_ * bytes, size * seconds_per_byte);
    }

    void simulation(std::size_t index) {
        const SimulationJob& run = *job_.data[index].simulation;
        const auto trajectories = static_cast<double>(run.trajectories);
        const double left_out = trajectories * static_cast<double>(run.transient);
        const double cores = std::min(threads_, trajectories);
        add("simulate",
            fmt::format("{} on {}", counted(static_cast<std::size_t>(points(index)), "point"),
                        counted(run.trajectories, "trajectory")),
            points(index) * n_ * bytes, (points(index) + left_out) * step(index) / cores);
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
        const double searched = points(job_.orbits->data) / (cut ? samples_per_crossing : 1.0);
        const double point = is_clean(data) ? clean_search : noisy_search;
        return (searched * point + periods * search_per_period) / threads_;
    }

    void periodic() {
        const PeriodicJob& periodic = *job_.periodic;
        const double crossing = seconds_per_crossing * n_ * (is_map() ? 0.01 : 1.0);
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
            // Orbits are followed one after the other, from the one before.
            add("branches", fmt::format("at most {:.0f} orbits", most),
                most * static_cast<double>(options.maximum_period) * n_ * (n_ + 1.0) * bytes, most * orbit / 10.0);
        }
    }

    /// Seconds of one evaluation of a stage's residuals with derivatives.
    [[nodiscard]] double sweep(const StageJob& stage) const {
        const EstimateJob& estimate = *job_.estimate;
        double seconds = 0.0;
        if (stage.uses(ResidualType::cycles)) {
            const double crossing = seconds_per_crossing * n_ * (is_map() ? 0.01 : 1.0);
            seconds += cycle_points() * crossing * directions() / threads_;
        }
        const auto add_records = [&](const std::vector<std::size_t>& indices) {
            for (const std::size_t index : indices)
                seconds += points(index) * step(index) * directions() / threads_;
        };
        if (stage.uses(ResidualType::series) && estimate.series) add_records(estimate.series->data);
        if (stage.uses(ResidualType::waveform) && estimate.waveform) add_records(estimate.waveform->data);
        if (stage.uses(ResidualType::branch))
            seconds += branch_orbits * orbit_steps * seconds_per_crossing * n_ * directions() / threads_;
        return seconds;
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
                count += points(index) * static_cast<double>(job_.data[index].observe.size());
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
            if (stage.kind == StageJob::Kind::prediction) {
                double seconds = 0.0;
                for (std::size_t i = 0; i < job_.data.size(); ++i)
                    seconds += std::min(points(i), prediction_intervals) * step(i);
                add(stage.name(), counted(estimate.parameters.size(), "parameter"), 0.0,
                    seconds * directions() * series_sweeps / threads_);
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
            add(estimate.strategy.size() > 1 ? stage.name() : "estimate", amount, memory, seconds);
        }
        exploration(last, free);
    }

    /// What is asked for beside the estimate; `sweep` seconds per evaluation.
    void exploration(double sweep, double free) {
        const EstimateJob& estimate = *job_.estimate;
        const auto unknowns = [free](const ParameterChoice& choice) {
            return choice.all ? free + 1.0 : static_cast<double>(choice.names.size());
        };
        if (estimate.multi_start.starts > 1) {
            const auto starts = static_cast<double>(estimate.multi_start.starts);
            add("starts", fmt::format("{} starts", estimate.multi_start.starts), 0.0, starts * sweep * series_sweeps);
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
    double threads_;
    double n_;
    std::vector<StageWork> work_;
};

/// One digit: more would promise too much.
std::string rough(double seconds) {
    if (!(seconds >= 0.1)) return "< 0.1 s";
    const double unit = std::pow(10.0, std::floor(std::log10(seconds)));
    return duration_text(std::round(seconds / unit) * unit);
}

}  // namespace

std::vector<StageWork> estimated_work(const Job& job, const DataCheck& data, int threads) {
    return Estimator(job, data, threads).all();
}

std::string work_table(const std::vector<StageWork>& work, int threads) {
    if (work.empty()) return {};
    SummaryTable table({left_aligned("stage"), left_aligned("amount"), "memory", "about"});
    double seconds = 0.0;
    for (const StageWork& stage : work) {
        seconds += stage.seconds;
        table.add({stage.stage, stage.amount,
                   stage.megabytes < 0.1 ? std::string() : fmt::format("{:.3g} MB", stage.megabytes),
                   rough(stage.seconds)});
    }
    return fmt::format("\nWork with {} thread{}, to a factor of five or so: {}\n{}", threads, threads == 1 ? "" : "s",
                       rough(seconds), table.text());
}

}  // namespace orbid::apps
