#include "apps/stored_run/segment_beginning.hpp"

#include <algorithm>
#include <optional>
#include <variant>

#include "apps/estimation/job_problem.hpp"
#include "apps/job/data_job.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

/// A job whose record begins at a state that is known already, as a start.
Job starting_at(const Job& job, const Eigen::VectorXd& state) {
    Job started = job;
    for (std::size_t i = 0; i < started.data[0].initial_state.size(); ++i) {
        InitialValueJob& initial = started.data[0].initial_state[i];
        if (initial.estimate) initial.value = state[static_cast<Eigen::Index>(i)];
    }
    return started;
}

/// The first samples of one segment as a record of their own.
Experiment beginning_of(const Experiment& record, std::size_t segment, Eigen::Index samples) {
    Experiment part;
    part.series = record.series;
    orbits::Segment cut = record.series.segments[segment];
    cut.values = cut.values.leftCols(samples).eval();
    cut.times = cut.times.head(samples).eval();
    if (cut.deviations.size() > 0) cut.deviations = cut.deviations.leftCols(samples).eval();
    part.series.segments = {std::move(cut)};
    if (!record.inputs.empty()) part.inputs = {record.inputs[segment]};
    return part;
}

}  // namespace

ErrorScales scales_of(const orbits::SeriesResidual& residual) {
    const auto count = static_cast<Eigen::Index>(residual.groups().size());
    ErrorScales scales{Eigen::VectorXd::Ones(count), Eigen::VectorXd::Zero(count)};
    for (Eigen::Index g = 0; g < count; ++g) {
        const estimator::Group& group = residual.groups()[static_cast<std::size_t>(g)];
        if (group.scale.value > 0.0) scales.value[g] = group.scale.value;
        if (const auto* relative = std::get_if<estimator::RelativeErrors>(&group.distribution))
            scales.relative[g] = relative->relative.value;
    }
    return scales;
}

SegmentBeginning fitted_beginning(const PredictionJob& job, const Experiment& record, std::size_t segment) {
    constexpr Eigen::Index least = 20;
    constexpr Eigen::Index share = 10;  // of the segment: a tenth
    constexpr double good = 2.0;        // normalised rms
    const Eigen::Index count = record.series.segments[segment].values.cols();
    const Eigen::Index most = std::max(count / share, std::min(least, count / 2));
    SegmentBeginning found;
    Eigen::Index samples = std::min(most, least);
    while (true) {
        const Experiment part = beginning_of(record, segment, samples);
        const Job& started = found.ok ? starting_at(job.derived, found.state) : job.derived;
        const auto problem = identification_problem(started, {&part, 1});
        const auto setup = estimate_setup(problem, fitted_labels(problem));
        std::optional<orbits::SegmentPrediction> fit;
        try {
            const auto residual = single_shooting(problem, 0, setup);
            const ErrorScales scales = scales_of(*residual);
            fit = residual->predict(setup.start(), scales.value, {0}, scales.relative).front();
        } catch (const orbits::DataError&) {
            // Too few readings among these samples: more of them may do.
        }
        const bool usable = fit && fit->status == estimator::BlockStatus::ok && fit->state.allFinite();
        // Without known errors a first fit counts, and later ones as long as they are no worse.
        const double limit = job.known_errors || !found.ok ? good : good * std::max(found.rms.norm(), 1e-300);
        const double misfit =
            job.known_errors || !found.ok ? (usable ? fit->normalised_rms : 0.0) : (usable ? fit->rms.norm() : 0.0);
        const bool better = usable && (!found.ok || misfit <= limit);
        if (better) found = {true, samples, fit->state, fit->rms};
        if ((found.ok && !better) || samples >= most) return found;
        samples = std::min(2 * samples, most);
    }
}

}  // namespace orbid::apps
