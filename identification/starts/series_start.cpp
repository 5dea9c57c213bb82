#include "identification/starts/series_start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "estimator/exploration/random_start.hpp"
#include "identification/problem/estimated_values.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/reading_noise.hpp"
#include "orbits/simulation/state_track.hpp"

namespace orbid::identification {

namespace {

/// Where an attempt begins.
struct Place {
    std::string name;
    Eigen::VectorXd theta;
    double turns = 0.0;  ///< length of intervals in turns; 0: as errors grow
};

/// Sampling intervals in a turn of what is read: of the fastest coordinate that turns at all.
double interval_of_turns(const Experiment& data, double turns) {
    double shortest = std::numeric_limits<double>::infinity();
    const orbits::Series& series = *data.series;
    for (const orbits::Segment& segment : series.segments)
        for (Eigen::Index row = 0; row < series.dimension(); ++row)
            shortest = std::min(shortest, orbits::samples_per_turn(segment.values.row(row).transpose()));
    return std::max(1.0, std::round(turns * shortest));
}

bool anything_hidden(const IdentificationProblem& problem) {
    return std::any_of(problem.series->data.begin(), problem.series->data.end(), [&](std::size_t experiment) {
        return std::ssize(problem.experiments[experiment].observe) < problem.system->dimension();
    });
}

/// Whether readings tell no states without the model.
bool anything_followed(const IdentificationProblem& problem) {
    return std::any_of(problem.series->data.begin(), problem.series->data.end(), [&](std::size_t experiment) {
        const Experiment& data = problem.experiments[experiment];
        return orbits::needs_tracking(*problem.system, *data.series, data.sensor);
    });
}

std::vector<Place> places(const IdentificationProblem& problem, const Options& options,
                          const std::vector<estimator::FreeParameter>& parameters) {
    constexpr double width = 0.4;
    const Eigen::VectorXd start = starts(parameters);
    const bool chosen = *problem.series->interval != SeriesChoice::automatic_interval;
    std::vector<Place> list{{"start", start, 0.0}};
    if (!chosen) {
        list.push_back({"an eighth of a turn", start, 0.125});
        list.push_back({"a third of a turn", start, 1.0 / 3.0});
    }
    // A chosen interval is the user's word, and readings that tell states leave few other minima.
    std::size_t others = anything_followed(problem) ? 12 : 3;
    if (chosen && !anything_followed(problem)) others = 0;
    const auto near = held_near(parameters, problem.joint_priors, width);
    for (std::uint64_t k = 0; k < others; ++k) {
        const estimator::RandomStream random(options.seed, estimator::RandomPurpose::multi_start, k);
        const double turns = chosen || k % 3 == 0 ? 0.0 : k % 3 == 1 ? 0.125 : 1.0 / 3.0;
        list.push_back({fmt::format("random start {}", k + 1),
                        estimator::random_start(near, problem.joint_priors, 1.0, random), turns});
    }
    return list;
}

SeriesStart start_at(const IdentificationProblem& problem, const Place& place) {
    SeriesStart start;
    start.theta = place.theta;
    start.follows = true;
    for (const std::size_t experiment : problem.series->data)
        start.intervals.push_back(place.turns > 0.0 ? static_cast<std::size_t>(interval_of_turns(
                                                          problem.experiments[experiment], place.turns))
                                                    : *problem.series->interval);
    return start;
}

std::string told(int number, const std::string& name, const SeriesAttempt& one) {
    return fmt::format("attempt {} ({}): {}, {} iterations, misfit {:.4g}{}", number, name,
                       one.cut ? std::string_view("given up") : estimator::name(one.estimate.status),
                       one.estimate.iterations, one.misfit, one.start.follows ? ": explains the readings" : "");
}

/// Work of attempts that is worth while, see ShootingResidual::work().
struct AffordableWork {
    std::uint64_t first, other, all;
};

/// Some 15 to 60 s of one processor in all for a record of some thousands of readings, and 300 steps of the integrator
/// per reading for a long one. A third of that is 45 iterations with two steps per reading.
AffordableWork affordable_work(const IdentificationProblem& problem, std::size_t parameters) {
    constexpr double least = 6e7, steps = 300.0;
    double readings = 0.0;
    for (const std::size_t experiment : problem.series->data)
        readings += static_cast<double>(problem.experiments[experiment].series->size());
    const double each =
        readings * static_cast<double>(1 + problem.system->dimension() + static_cast<std::ptrdiff_t>(parameters));
    const double all = std::max(least, steps * each);
    return {static_cast<std::uint64_t>(all / 2.0), static_cast<std::uint64_t>(std::max(all / 8.0, steps * each / 3.0)),
            static_cast<std::uint64_t>(all)};
}

std::string too_costly(int attempts) {
    return fmt::format("the search for a start is given up after {} attempts: more would cost too much", attempts);
}

std::string unexplained(int attempts) {
    return fmt::format(
        "from {} starts the model follows no course that explains the readings by their errors alone: it misses "
        "something, or none of these starts is near enough (\"start\" of parameters and of \"initial_state\")",
        attempts);
}

/// How attempts have ended of which none explains the readings.
struct Failure {
    bool agree, ended, costly;  ///< two agree; one was not cut; the search has used up its work
    std::uint64_t affordable;   ///< work of an estimate that is likely to be in vain
    std::uint64_t most;         ///< of one that may still succeed
};

/// What that means for the estimate, and for whoever reads the results.
void judge_failure(const Failure& how, bool hidden, const SeriesSearch& search, SeriesStart& start) {
    start.several_ends = !how.agree;
    start.doubtful = hidden && start.several_ends;
    // Where readings tell the states, an estimate from them may still succeed, unless not even one attempt could end.
    start.affordable = start.doubtful || !how.ended ? how.affordable : how.most;
    if (!search.remark) return;
    if (how.costly && !how.agree) search.remark(too_costly(start.attempts));
    if (hidden) search.remark(unexplained(start.attempts));
}

/// Nearer parameters tell hidden states better than those at which an attempt has followed them: the same once more
/// from where it has ended. @return the better one
SeriesAttempt with_states_anew(SeriesAttempts& run, SeriesAttempt found, const SeriesStart& place, int number,
                               const SeriesSearch& search) {
    SeriesStart start = place;
    start.theta = found.start.theta;
    SeriesAttempt other;
    try {
        other = run.make("states anew", start);
    } catch (const orbits::DataError&) {  // none can be followed from there
        return found;
    }
    if (search.log) search.log(told(number, "states anew", other));
    SeriesAttempt& better = other.start.follows || other.misfit < found.misfit ? other : found;
    better.estimate.iterations = found.estimate.iterations + other.estimate.iterations;
    better.estimate.evaluations = found.estimate.evaluations + other.estimate.evaluations;
    return std::move(better);
}

}  // namespace

bool needs_search(const IdentificationProblem& problem) {
    const auto& experiments = problem.series->data;
    const auto sampled = [&](std::size_t i) {
        return problem.experiments[i].series->sampling == orbits::Series::Sampling::samples;
    };
    if (!std::all_of(experiments.begin(), experiments.end(), sampled)) return false;
    if (problem.series->matching.kind == Matching::Kind::exact) return anything_hidden(problem);
    return problem.series->matching.kind == Matching::Kind::automatic;
}

SeriesStart search_series_start(const IdentificationProblem& problem, const Options& options,
                                const EstimateSetup& setup, const std::vector<estimator::FreeParameter>& parameters,
                                const SeriesSearch& search) {
    const std::vector<Place> list = places(problem, options, parameters);
    SeriesAttempts run(problem, setup, parameters, search);
    const AffordableWork most_work = affordable_work(problem, parameters.size());
    run.limit(most_work.first, most_work.all);
    const bool followed = anything_followed(problem);
    std::uint64_t all = most_work.all;
    std::optional<SeriesAttempt> best;
    std::optional<orbits::DataError> refused;
    constexpr double same_misfit = 1e-4;
    const auto has_converged = [](const SeriesAttempt& one) {
        return one.estimate.status == estimator::EstimateStatus::converged;
    };
    using Begun = std::pair<Eigen::VectorXd, std::vector<std::size_t>>;
    std::vector<Begun> begun;  // parameters, and intervals as they were chosen
    std::vector<Eigen::VectorXd> refused_at;
    bool agree = false, ended = false;
    int made = 0, iterations = 0, evaluations = 0;
    for (const Place& place : list) {
        if ((search.estimate.interrupted && search.estimate.interrupted()) || run.work() > all) break;
        const SeriesStart start = start_at(problem, place);
        // What errors suggested may have been an eighth of a turn.
        if (std::find(begun.begin(), begun.end(), Begun{start.theta, start.intervals}) != begun.end()) continue;
        // States that cannot be told are no matter of intervals.
        if (std::find(refused_at.begin(), refused_at.end(), start.theta) != refused_at.end()) continue;
        ++made;
        SeriesAttempt one;
        try {
            one = run.make(place.name, start);
        } catch (const orbits::DataError& error) {
            if (!refused) refused = error;
            refused_at.push_back(start.theta);
            if (search.log) search.log(fmt::format("attempt {} ({}): {}", made, place.name, error.what()));
            continue;
        }
        begun.emplace_back(place.theta, one.start.intervals);
        ended = ended || !one.cut;
        if (search.log) search.log(told(made, place.name, one));
        if (followed && !one.start.follows && one.has_ended() && std::isfinite(one.misfit) &&
            (!best || one.misfit < best->misfit)) {
            // Apart from the work of other starts, as it is likely to lead farther; but from a good start few steps do.
            const std::uint64_t before = run.work();
            run.limit(most_work.other / 2, all + most_work.other);
            one = with_states_anew(run, std::move(one), start, made, search);
            all += run.work() - before;
        }
        run.limit(most_work.other, all);
        one = run.on_better_sides(std::move(one));
        iterations += one.estimate.iterations;
        evaluations += one.estimate.evaluations;
        // Where two agree, the model misses something, and others would find the same.
        agree = best && !one.start.follows && has_converged(one) && has_converged(*best) &&
                std::abs(one.misfit - best->misfit) < same_misfit;
        if (agree) break;
        if (best && !one.start.follows && !(one.misfit < best->misfit)) continue;
        best = one.start.follows ? run.with_signs_of_start(std::move(one)) : std::move(one);
        if (search.reached && std::isfinite(best->misfit)) search.reached(best->start.theta);
        if (best->start.follows) break;
    }
    if (!best && refused) throw *refused;
    SeriesStart start;
    if (best && (best->start.follows || (followed && std::isfinite(best->misfit)))) start = best->start;
    if (start.theta.size() == 0) start.theta = starts(parameters);
    start.attempts = made;
    start.iterations = iterations;
    start.evaluations = evaluations;
    const bool stopped = search.estimate.interrupted && search.estimate.interrupted();
    if (!start.follows && !stopped)
        judge_failure({agree, ended, run.work() > all, most_work.first, most_work.all}, followed, search, start);
    return start;
}

}  // namespace orbid::identification
