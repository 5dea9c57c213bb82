#include "apps/stored_run/motion_prediction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include "apps/estimation/job_problem.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/counted_noun.hpp"
#include "apps/stages/branch_stage.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::apps {

namespace {

using Eigen::Index;
using identification::BranchChoice;
using identification::BranchSheets;
using identification::PredictedBranch;
using identification::PredictedQuantities;
using periodic::OrbitMeasure;

using estimator::nan_value;
constexpr double normal95 = 1.959963984540054;

void name_quantities(const Job& job, const std::vector<periodic::OrbitReading>& readings, MotionPrediction& out) {
    std::vector<std::pair<std::string, std::string>> read;
    for (const models::Coordinate& one : job.model.system->coordinates())
        read.emplace_back(one.name, one.unit);
    for (const periodic::OrbitReading& one : readings)
        read.emplace_back(one.name, one.unit);
    for (const auto& [name, unit] : read)
        for (int m = 0; m < static_cast<int>(OrbitMeasure::frequency); ++m) {
            out.quantities.push_back(name + "." + periodic::name_of(static_cast<OrbitMeasure>(m)));
            out.units.push_back(unit);
        }
    out.quantities.emplace_back("frequency");
    out.units.emplace_back("Hz");
    out.quantities.emplace_back("multiplier");
    out.units.emplace_back("1");
}

periodic::StartingSolution start_of(const Job& job, const OrbitStart& orbit) {
    periodic::StartingSolution start;
    start.points = orbit.points;
    start.rotation = orbit.rotation;
    start.phase = job.section_phase;
    start.section = job_section(job);
    start.time = orbit.time;
    return start;
}

/// The sd that the run estimated for errors of a measure of this size; nan where it did not.
double error_of_run(const StoredRun& run, const std::string& measure, double predicted) {
    const auto pointer = StoredRun::Json::json_pointer("/errors/branch." + measure);
    if (!run.result->contains(pointer)) return nan_value;
    const auto& group = run.result->at(pointer);
    if (!group.contains("sd") || !group["sd"].is_number()) return nan_value;
    const double sd = group["sd"].get<double>();
    const std::string distribution = group.value("distribution", std::string("normal"));
    if (distribution == "lognormal") return sd * std::abs(predicted);
    if (group.contains("relative") && group["relative"].is_object() && group["relative"].contains("value"))
        return std::hypot(sd, group["relative"]["value"].get<double>() * predicted);
    return sd;
}

/// The sheet whose orbit leaves the least of a motion, relative to what was measured: at the estimate, or the middle of
/// the band of draws where only these have one.
/// @param stable  only sheets that are so there
std::optional<int> nearest_sheet(const PredictedBranch& branch, const BranchSheets& sheets, const BranchChoice& asked,
                                 Index motion, std::optional<bool> stable) {
    std::optional<int> best;
    double least = std::numeric_limits<double>::infinity();
    auto [lowest, highest] = sheets.range();
    for (const BranchSheets& draw : branch.draws) {
        lowest = std::min(lowest, draw.range().first);
        highest = std::max(highest, draw.range().second);
    }
    for (int sheet = lowest; sheet <= highest; ++sheet) {
        const PredictedQuantities all = quantities_at(branch, sheets, sheet, asked.at[motion]);
        if (all.value.size() == 0) continue;
        const double multiplier = all.value(branch.layout.multiplier());
        const bool is_stable = std::isfinite(multiplier) ? multiplier <= 1.0 : all.stable > 0.5;
        if (stable && is_stable != *stable) continue;
        const Eigen::VectorXd value = all.value.array().isFinite().select(all.value, 0.5 * (all.lower95 + all.upper95));
        double misfit = 0.0;
        for (std::size_t c = 0; c < asked.channels.size(); ++c) {
            const auto& channel = asked.channels[c];
            const double observed = asked.values(static_cast<Index>(c), motion);
            if (std::isnan(observed)) continue;
            const double e = value(branch.layout.of_measure(channel.measure, channel.errors.coordinate)) - observed;
            misfit += e * e / std::max(observed * observed, 1e-300);
        }
        if (misfit < least) {
            least = misfit;
            best = sheet;
        }
    }
    return best;
}

/// What was measured of one motion beside the branch.
MeasuredMotion compared_motion(const StoredRun& run, const MotionQuestion& question, const BranchSheets& sheets,
                               const BranchChoice& asked, Index motion, MotionPrediction& out) {
    const Job& job = question.job;
    MeasuredMotion mark;
    mark.parameter = asked.at[motion];
    mark.label = fmt::format("{} = {}", out.parameter, mark.parameter);
    const auto sheet = nearest_sheet(out.branch, sheets, asked, motion, question.stable);
    PredictedQuantities predicted;
    if (sheet) {
        predicted = quantities_at(out.branch, sheets, *sheet, mark.parameter);
        if (out.draws == 0) predicted = identification::delta_at(out.branch, *sheet, mark.parameter, predicted.value);
        const double multiplier = predicted.value(out.branch.layout.multiplier());
        mark.used = std::isfinite(multiplier);
        if (mark.used) mark.unstable = multiplier > 1.0 ? 1 : 0;
    } else {
        mark.used = false;
    }
    for (std::size_t c = 0; c < asked.channels.size(); ++c) {
        const auto& channel = asked.channels[c];
        ComparedMeasure one;
        one.motion = mark.label;
        one.parameter = mark.parameter;
        one.observed = asked.values(static_cast<Index>(c), motion);
        if (std::isnan(one.observed)) continue;
        const BranchResidualJob& branch = *job.estimate->branch;
        one.name = branch.measure_name(*job.model.system, channel.measure, channel.errors.coordinate);
        one.unit = channel.measure == OrbitMeasure::frequency
                       ? "Hz"
                       : branch.quantity(*job.model.system, channel.errors.coordinate).second;
        one.predicted = one.sd = one.lower95 = one.upper95 = one.stable = nan_value;
        if (sheet) {
            const Index at = out.branch.layout.of_measure(channel.measure, channel.errors.coordinate);
            one.predicted = predicted.value(at);
            one.sd = predicted.sd(at);
            one.lower95 = predicted.lower95(at);
            one.upper95 = predicted.upper95(at);
            one.sheet = *sheet;
            one.found = predicted.found;
            one.stable = predicted.stable;
            one.is_stable = mark.used ? mark.unstable == 0 : predicted.stable > 0.5;
        }
        const bool known = asked.deviations.size() > 0 && asked.deviations(static_cast<Index>(c), motion) > 0.0;
        one.error_sd =
            known ? asked.deviations(static_cast<Index>(c), motion) : error_of_run(run, one.name, one.predicted);
        mark.values.push_back({one.name, one.unit, one.observed, one.predicted, one.error_sd});
        out.compared.push_back(std::move(one));
    }
    return mark;
}

void add_branch(const StoredRun& run, const MotionQuestion& question, const identification::ParameterDraws& draws,
                const std::vector<periodic::OrbitReading>& readings, const identification::PredictionRun& watch,
                const std::optional<BranchChoice>& asked, MotionPrediction& out) {
    const Job& job = question.job;
    const ContinuationJob& continuation = *job.periodic->continuation;
    periodic::ContinuationOptions options = continuation.options;
    options.solver.maximum_distance = std::numeric_limits<double>::infinity();
    const models::Parameter& parameter = job.model.parameter(options.parameter);
    out.parameter = parameter.name;
    out.unit = parameter.unit;
    out.has_branch = true;
    out.branch = identification::predict_branch(*job.model.system, question.posterior, draws,
                                                start_of(job, job.periodic->orbits[continuation.orbit]), options,
                                                readings, watch);
    if (out.branch.branch.points.empty()) {
        out.followed.message =
            fmt::format("no branch begins at the given orbit at the estimate: {}", periodic::name(out.branch.start));
        out.remarks.push_back(out.followed.message);
        return;
    }
    if (out.draws > out.branch.followed)
        out.remarks.push_back(fmt::format("in {} of {} draws the start of the branch has no orbit: a fold lies between",
                                          out.draws - out.branch.followed, out.draws));
    out.followed.branches = {out.branch.branch};
    thin_out(job, out.followed.branches);
    for (const periodic::OrbitReading& reading : readings)
        out.followed.readings.push_back({reading.name, reading.unit, false});
    if (!asked) return;
    const BranchSheets sheets = sheets_of(out.branch, job.model.values[options.parameter]);
    for (Index m = 0; m < asked->at.size(); ++m)
        out.followed.measured.push_back(compared_motion(run, question, sheets, *asked, m, out));
    const auto few = std::count_if(out.compared.begin(), out.compared.end(), [&](const ComparedMeasure& one) {
        return out.draws > 0 && one.found > 0 && one.found < identification::fewest_draws;
    });
    if (few > 0)
        out.remarks.push_back(
            fmt::format("{} of {} measures have fewer than {} draws with such an orbit, and so no "
                        "interval: ask for more by \"bands\": {{ \"draws\": ... }}",
                        few, out.compared.size(), identification::fewest_draws));
    const auto lost = std::count_if(out.followed.measured.begin(), out.followed.measured.end(),
                                    [](const MeasuredMotion& motion) { return !motion.used; });
    if (lost > 0)
        out.remarks.push_back(fmt::format("{} of {} measured motions lie where the branch at the estimate has no orbit",
                                          lost, out.followed.measured.size()));
}

/// Where bands and the delta method disagree, one of them is wrong: near folds it is the second.
void remark_on_methods(MotionPrediction& out) {
    double worst = 1.0;
    double at = nan_value;
    for (std::size_t k = 0; out.draws > 0 && k < out.branch.points.size(); ++k) {
        const PredictedQuantities& point = out.branch.points[k];
        if (point.sd.size() == 0 || point.found < identification::fewest_draws) continue;
        const Index frequency = out.branch.layout.frequency();
        for (Index i = 0; i < frequency; ++i) {
            // What hardly varies is no measure of a method.
            if (!(point.sd(i) > 1e-6 * std::abs(point.value(i))) || !(point.delta_sd(i) > 0.0)) continue;
            const double ratio = point.delta_sd(i) / point.sd(i);
            if (ratio > worst) {
                worst = ratio;
                at = out.branch.branch.points[k].parameter;
            }
        }
    }
    if (worst > 1.5)
        out.remarks.push_back(
            fmt::format("sds of the delta method are up to {:.2g} times those of the draws, at {} = "
                        "{:.6g}: near a fold it does not hold, and bands are those of the draws",
                        worst, out.parameter, at));
}

}  // namespace

bool ComparedMeasure::inside_with_errors() const {
    return std::abs(observed - predicted) <= normal95 * std::hypot(sd, error_sd);
}

MotionPrediction predict_motions(
    const StoredRun& run, const MotionQuestion& question,
    const std::function<void(const std::string& what, std::size_t done, std::size_t total)>& progress) {
    const Job& job = question.job;
    // Before minutes of draws: a table may lack a column.
    const auto asked = job.estimate ? std::optional(measured_branch(job)) : std::nullopt;
    MotionPrediction out;
    out.remarks = question.remarks;
    for (const Index parameter : question.posterior.parameters)
        out.parameters.emplace_back(job.model.parameter(parameter).name);
    const std::vector<periodic::OrbitReading> readings =
        job.estimate ? job.estimate->branch->readings : std::vector<periodic::OrbitReading>{};
    name_quantities(job, readings, out);
    identification::ParameterDraws draws;
    draws.values.resize(job.model.values.size(), 0);
    if (question.draws) {
        try {
            draws = draw_parameters(*job.model.system, question.posterior, question.count, question.seed);
        } catch (const std::invalid_argument& error) {
            throw StoredRunRefused(fmt::format("{}: {}", run.folder.string(), error.what()));
        }
    }
    out.draws = static_cast<std::size_t>(draws.values.cols());
    out.from_sample = draws.from_sample;
    out.outside = draws.outside;
    if (out.from_sample && out.draws < question.count)
        out.remarks.push_back(
            fmt::format("the run has {} of the posterior: all of them are used", counted(out.draws, "draw")));
    const auto watching = [&](const std::string& what) {
        identification::PredictionRun watch;
        if (progress) progress(what, 0, out.draws);
        if (progress) watch.progress = [&, what](std::size_t done) { progress(what, done, out.draws); };
        return watch;
    };
    // A branch answers for its own start.
    const bool orbits = !job.periodic->continuation || question.asks_orbits;
    for (std::size_t s = 0; orbits && s < job.periodic->orbits.size(); ++s)
        for (const Eigen::VectorXd& to : question.at) {
            AskedOrbit& one = out.orbits.emplace_back();
            one.start = s;
            for (Index i = 0; i < to.size(); ++i)
                if (to(i) != job.model.values(i)) one.at.emplace_back(job.model.parameter(i).name, to(i));
            one.predicted = identification::predict_orbit(*job.model.system, question.posterior, draws,
                                                          start_of(job, job.periodic->orbits[s]), to, readings,
                                                          watching(fmt::format("orbit {}", out.orbits.size())));
        }
    if (job.periodic->continuation) add_branch(run, question, draws, readings, watching("branch"), asked, out);
    remark_on_methods(out);
    return out;
}

}  // namespace orbid::apps
