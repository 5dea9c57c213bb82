#include "identification/starts/series_start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "estimator/exploration/random_start.hpp"
#include "identification/problem/estimated_values.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/reading_noise.hpp"
#include "orbits/simulation/state_track.hpp"

namespace orbid::identification {

namespace {

orbits::Continuity matching(const IdentificationProblem& problem, const Experiment& data) {
    const Matching& asked = problem.series->matching;
    orbits::Continuity result;
    // A simulated record follows its equations; a measured one only as far as the model is right.
    const bool perfect =
        asked.kind == Matching::Kind::exact || (asked.kind == Matching::Kind::automatic && data.follows_model);
    result.kind = perfect ? orbits::Continuity::Kind::exact : orbits::Continuity::Kind::normal;
    result.estimate = !perfect && asked.kind != Matching::Kind::given;
    if (asked.kind == Matching::Kind::given) result.share = asked.sd;
    return result;
}

/// What is known of the first states; empty where nothing is.
Eigen::VectorXd first_state(const Experiment& data) {
    Eigen::VectorXd state =
        Eigen::VectorXd::Constant(std::ssize(data.initial_state), std::numeric_limits<double>::quiet_NaN());
    for (std::size_t i = 0; i < data.initial_state.size(); ++i)
        if (data.initial_state[i].value) state[static_cast<Eigen::Index>(i)] = *data.initial_state[i].value;
    return state.array().isFinite().any() ? state : Eigen::VectorXd();
}

/// Errors whose sd is estimated begin at these.
void begin_errors(const std::vector<double>& sds, std::vector<estimator::ErrorScale>& errors) {
    for (std::size_t i = 0; i < errors.size() && i < sds.size(); ++i)
        if (errors[i].estimate && !(errors[i].value > 0.0) && sds[i] > 0.0) errors[i].value = sds[i];
}

/// @param place  of the experiment among those of the series.
orbits::ShootingOptions shooting_options(const IdentificationProblem& problem, std::size_t place,
                                         const SeriesStart& start) {
    const SeriesChoice& asked = *problem.series;
    const Experiment& data = problem.experiments[asked.data[place]];
    orbits::ShootingOptions options;
    options.name = asked.data.size() > 1 ? "series." + data.name : "series";
    options.sensor = data.sensor;
    for (const Eigen::Index coordinate : data.observe) {
        options.observe.emplace_back(problem.coordinate(coordinate).name);
        // A rate that is a difference of two readings has the errors of the angle.
        const bool second = data.sensor.type == models::Sensor::Type::angle_difference &&
                            coordinate == static_cast<Eigen::Index>(data.sensor.rate);
        const Eigen::Index own = second ? static_cast<Eigen::Index>(data.sensor.angle) : coordinate;
        for (const RecordErrors& error : asked.errors) {
            if (error.coordinate != own) continue;
            options.errors.push_back(error.scale);
            options.forms.push_back(error_form(error));
        }
    }
    options.segments = data.fitted_segments();
    options.matching = matching(problem, data);
    if (start.follows) options.matching = orbits::Continuity{};
    const std::size_t interval = start.intervals.empty() ? *asked.interval : start.intervals[place];
    options.interval = static_cast<Eigen::Index>(interval);
    options.start = start.theta;
    options.first_state = first_state(data);
    if (!start.nodes.empty()) options.nodes = start.nodes[place];
    if (!start.reading_sds.empty()) begin_errors(start.reading_sds[place], options.errors);
    return options;
}

/// One way to begin.
struct Attempt {
    std::string name;
    Eigen::VectorXd theta;
    double turns = 0.0;  ///< length of intervals in turns; 0: as errors grow
};

/// What an attempt has come to.
struct Attempted {
    SeriesStart start;
    estimator::Estimate estimate;
    double misfit = std::numeric_limits<double>::infinity();  ///< less is better
};

/// Whether the residuals of the readings are those of independent errors, as large as readings scatter about a smooth
/// course, and no two intervals are left apart.
bool explains(const IdentificationProblem& problem, std::size_t place, const orbits::ShootingResidual& residual,
              const estimator::Estimate& estimate) {
    constexpr double most_excess = 1.25, least_correlation = 0.1, normal_limit = 5.0;
    const Experiment& data = problem.experiments[problem.series->data[place]];
    if (residual.defect(estimate.active[place], estimated_theta(estimate), estimate.latents[place]).large > 0)
        return false;
    const bool difference = data.sensor.type == models::Sensor::Type::angle_difference;
    for (const estimator::Group& group : residual.groups()) {
        const auto* scale = scale_of(estimate, group.name);
        if (scale == nullptr || !group.ordered || !(scale->count > 0)) continue;
        const auto count = static_cast<double>(scale->count);
        if (std::abs(scale->lag1) > std::max(least_correlation, normal_limit / std::sqrt(count))) return false;
        const std::string coordinate = group.name.substr(group.name.rfind('.') + 1);
        const orbits::Series& series = *data.series;
        Eigen::Index row = -1;
        for (Eigen::Index i = 0; i < series.dimension(); ++i)
            if (series.coordinate(i).name == coordinate) row = i;
        const Eigen::Index index = problem.system->coordinate_index(coordinate);
        if (row < 0 || index < 0 || difference) continue;
        const bool angle =
            models::reads_angle(data.sensor, problem.system->coordinates(), static_cast<std::size_t>(index));
        double noise = 0.0;
        for (const std::size_t s : residual.fitted())
            noise = std::max(noise, orbits::reading_noise(series.segments[s].values.row(row).transpose(), angle));
        if (noise > 0.0 && scale->rms > most_excess * noise) return false;
    }
    return true;
}

/// What readings miss and what links miss in a sampling interval, each as the mean of ln(rms) in units of the ranges.
/// Links are no better than exact matching can be.
double misfit_of(const ProblemResiduals& residuals, const estimator::Estimate& estimate) {
    double sum = 0.0;
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const orbits::ShootingResidual& one = *residuals.shooting[i];
        const double least = orbits::sampled_tightness * one.noise(estimate.active[i]);
        const double intervals = std::sqrt(static_cast<double>(one.interval()));
        const auto links = static_cast<std::size_t>(one.range().size());
        const std::size_t readings = one.groups().size() - links;
        for (std::size_t g = 0; g < one.groups().size(); ++g) {
            const auto* scale = scale_of(estimate, one.groups()[g].name);
            if (scale == nullptr) continue;
            const bool link = g >= readings;
            const double size = link ? one.range()[static_cast<Eigen::Index>(g - readings)] : one.reading_range(g);
            const double rms = scale->rms / size;
            sum +=
                std::log(link ? std::max(rms / intervals, least) : rms) / static_cast<double>(link ? links : readings);
        }
    }
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

/// Parameters with a prior as wide as their start is large, where they have none.
std::vector<estimator::FreeParameter> held_near(std::vector<estimator::FreeParameter> parameters, double width) {
    for (estimator::FreeParameter& one : parameters)
        if (std::holds_alternative<estimator::FlatPrior>(one.prior) && one.tied_to.empty() && one.start != 0.0)
            one.prior = estimator::NormalPrior{one.start, width * std::abs(one.start)};
    return parameters;
}

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

std::vector<Attempt> attempts(const IdentificationProblem& problem, const Options& options,
                              const std::vector<estimator::FreeParameter>& parameters) {
    constexpr double width = 0.4;
    const Eigen::VectorXd start = starts(parameters);
    const bool chosen = *problem.series->interval != SeriesChoice::automatic_interval;
    std::vector<Attempt> list{{"start", start, 0.0}};
    if (!chosen) {
        list.push_back({"an eighth of a turn", start, 0.125});
        list.push_back({"a third of a turn", start, 1.0 / 3.0});
    }
    const std::size_t others = anything_hidden(problem) ? 12 : 6;
    const auto near = held_near(parameters, width);
    for (std::uint64_t k = 0; k < others; ++k) {
        const estimator::RandomStream random(options.seed, estimator::RandomPurpose::multi_start, k);
        const double turns = chosen || k % 3 == 0 ? 0.0 : k % 3 == 1 ? 0.125 : 1.0 / 3.0;
        list.push_back({fmt::format("random start {}", k + 1),
                        estimator::random_start(near, problem.joint_priors, 1.0, random), turns});
    }
    return list;
}

class SeriesAttempts {
public:
    SeriesAttempts(const IdentificationProblem& problem, const EstimateSetup& setup,
                   const std::vector<estimator::FreeParameter>& parameters, const SeriesSearch& search)
        : problem_(problem), setup_(setup), parameters_(parameters), search_(search) {}

    /// The same from its nodes with the signs of the starts, where those explain the readings as well: a sign that
    /// nothing tells (l in l^2) is not to change.
    Attempted with_signs_of_start(Attempted found) {
        std::vector<Eigen::VectorXd> flipped;
        Eigen::VectorXd all = found.start.theta;
        for (std::size_t i = 0; i < parameters_.size(); ++i) {
            const auto k = static_cast<Eigen::Index>(i);
            if (!parameters_[i].tied_to.empty() || !(parameters_[i].start * all[k] < 0.0)) continue;
            all[k] = -all[k];
            flipped.push_back(found.start.theta);
            flipped.back()[k] = all[k];
        }
        if (flipped.size() > 1) flipped.insert(flipped.begin(), all);
        for (const Eigen::VectorXd& theta : flipped) {
            SeriesStart start = found.start;
            start.theta = theta;
            Attempted other = from("signs of the start", start);
            if (other.start.follows && changed_signs(other) < changed_signs(found)) return other;
        }
        return found;
    }

    Attempted make(const Attempt& attempt) {
        SeriesStart start;
        start.theta = attempt.theta;
        start.follows = true;
        for (const std::size_t experiment : problem_.series->data)
            start.intervals.push_back(attempt.turns > 0.0 ? static_cast<std::size_t>(interval_of_turns(
                                                                problem_.experiments[experiment], attempt.turns))
                                                          : *problem_.series->interval);
        return from(attempt.name, start);
    }

private:
    Attempted from(const std::string& name, const SeriesStart& start) {
        constexpr int most_steps = 45;
        constexpr double rough = 1e-2;
        constexpr double prior_width = 0.5;
        // A flow of an interval that takes more steps than this goes where no start belongs.
        constexpr models::FlowOptions quick_flow{1e-11, 1e-11, 2000};
        Attempted result;
        ProblemResiduals residuals;
        add_shooting(problem_, setup_, start, residuals, quick_flow);
        std::vector<estimator::FreeParameter> near = held_near(parameters_, prior_width);
        for (std::size_t i = 0; i < near.size(); ++i)
            near[i].start = start.theta[static_cast<Eigen::Index>(i)];
        estimator::EstimateOptions options = search_.estimate;
        options.variance = estimator::Variance::ml;
        options.verdict = false;
        options.maximum_iterations = most_steps;
        options.step_tolerance = rough;
        options.watched = [&](const estimator::StepReport& report) {
            if (search_.watched) search_.watched(name, report);
            if (search_.reached && !reached_) search_.reached(report.theta);
        };
        result.estimate = estimator::estimate(near, residuals.all(), {}, options);
        if (is_on_its_way(result.estimate)) go_on(near, residuals, options, result.estimate);
        const estimator::Estimate& found = result.estimate;
        const bool whole = found.status != estimator::EstimateStatus::failed && !found.parameters.empty() &&
                           found.latents.size() == residuals.shooting.size();
        if (!whole) return result;
        reached_ = true;
        result.start = nodes_at(residuals, found);
        for (std::size_t i = 0; i < residuals.shooting.size(); ++i)
            result.start.reading_sds.push_back(reading_sds(i, *residuals.shooting[i], found));
        result.misfit = misfit_of(residuals, found);
        result.start.follows = found.status != estimator::EstimateStatus::interrupted;
        for (std::size_t i = 0; i < residuals.shooting.size() && result.start.follows; ++i)
            result.start.follows =
                !found.active[i].is_intermediate_stage && explains(problem_, i, *residuals.shooting[i], found);
        return result;
    }

    /// How many parameters have another sign than at their start.
    [[nodiscard]] std::ptrdiff_t changed_signs(const Attempted& one) const {
        std::ptrdiff_t count = 0;
        for (std::size_t i = 0; i < parameters_.size(); ++i)
            count += parameters_[i].start * one.start.theta[static_cast<Eigen::Index>(i)] < 0.0 ? 1 : 0;
        return count;
    }

    /// All stages are behind it, and only steps are missing.
    static bool is_on_its_way(const estimator::Estimate& estimate) {
        return estimate.status == estimator::EstimateStatus::iteration_limit && !estimate.parameters.empty() &&
               std::none_of(estimate.active.begin(), estimate.active.end(),
                            [](const estimator::ActiveSet& one) { return one.is_intermediate_stage; });
    }

    /// Goes on from where an attempt has come to.
    void go_on(std::vector<estimator::FreeParameter> near, ProblemResiduals& residuals,
               const estimator::EstimateOptions& options, estimator::Estimate& estimate) const {
        for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
            const orbits::ShootingResidual& one = *residuals.shooting[i];
            residuals.shooting[i] = std::make_unique<orbits::ShootingResidual>(
                one.with(one.matching(), estimate.active[i], estimate.latents[i], estimated_theta(estimate)));
        }
        for (std::size_t i = 0; i < near.size(); ++i)
            near[i].start = estimate.parameters[i].value;
        const int iterations = estimate.iterations, evaluations = estimate.evaluations;
        estimate = estimator::estimate(near, residuals.all(), {}, options);
        estimate.iterations += iterations;
        estimate.evaluations += evaluations;
    }

    /// By observed coordinate; empty where two of them share an error.
    [[nodiscard]] std::vector<double> reading_sds(std::size_t place, const orbits::ShootingResidual& residual,
                                                  const estimator::Estimate& estimate) const {
        const auto readings = std::ssize(residual.groups()) - residual.range().size();
        std::vector<double> sds;
        if (readings != std::ssize(problem_.experiments[problem_.series->data[place]].observe)) return sds;
        for (std::ptrdiff_t g = 0; g < readings; ++g) {
            const auto* scale = scale_of(estimate, residual.groups()[static_cast<std::size_t>(g)].name);
            sds.push_back(scale != nullptr && !scale->factor ? scale->value : 0.0);
        }
        return sds;
    }

    const IdentificationProblem& problem_;
    const EstimateSetup& setup_;
    const std::vector<estimator::FreeParameter>& parameters_;
    const SeriesSearch& search_;
    bool reached_ = false;  ///< an attempt has come to something
};

}  // namespace

SeriesStart nodes_at(const ProblemResiduals& residuals, const estimator::Estimate& estimate) {
    SeriesStart start;
    start.theta = estimated_theta(estimate);
    const std::size_t first = (residuals.cycles ? 1 : 0) + residuals.series.size();
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const orbits::ShootingResidual& residual = *residuals.shooting[i];
        const auto& latents = estimate.latents.at(first + i);
        const auto& nodes = residual.plan().nodes;
        start.intervals.push_back(static_cast<std::size_t>(residual.interval()));
        std::vector<Eigen::MatrixXd>& segments = start.nodes.emplace_back();
        for (std::size_t begin = 0; begin < nodes.size();) {
            std::size_t end = begin;
            while (end < nodes.size() && nodes[end].segment == nodes[begin].segment)
                ++end;
            Eigen::MatrixXd states(latents[begin].size(), static_cast<Eigen::Index>(end - begin));
            for (std::size_t b = begin; b < end; ++b)
                states.col(static_cast<Eigen::Index>(b - begin)) = latents[b];
            segments.push_back(std::move(states));
            begin = end;
        }
    }
    return start;
}

void add_shooting(const IdentificationProblem& problem, const EstimateSetup& setup, const SeriesStart& start,
                  ProblemResiduals& residuals, const std::optional<models::FlowOptions>& flow) {
    const auto& experiments = problem.series->data;
    for (std::size_t i = 0; i < experiments.size(); ++i) {
        const std::size_t experiment = experiments[i];
        const Experiment& measured = problem.experiments[experiment];
        orbits::ShootingOptions options = shooting_options(problem, i, start);
        options.inputs = measured.inputs;
        options.delay = setup.delay(measured, experiment);
        if (flow) options.flow = *flow;
        try {
            residuals.shooting.push_back(std::make_unique<orbits::ShootingResidual>(
                problem.system, setup.experiments[experiment], *measured.series, std::move(options)));
        } catch (const orbits::DataError& error) {
            throw orbits::DataError(fmt::format("{}: {}", measured.name, error.what()));
        }
        residuals.shooting_experiments.push_back(experiment);
    }
}

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
    const std::vector<Attempt> list = attempts(problem, options, parameters);
    SeriesAttempts run(problem, setup, parameters, search);
    std::optional<Attempted> best;
    std::optional<orbits::DataError> refused;
    int made = 0, iterations = 0, evaluations = 0;
    for (const Attempt& attempt : list) {
        if (search.estimate.interrupted && search.estimate.interrupted()) break;
        ++made;
        Attempted one;
        try {
            one = run.make(attempt);
        } catch (const orbits::DataError& error) {
            if (!refused) refused = error;
            if (search.log) search.log(fmt::format("attempt {} ({}): {}", made, attempt.name, error.what()));
            continue;
        }
        iterations += one.estimate.iterations;
        evaluations += one.estimate.evaluations;
        if (search.log)
            search.log(fmt::format("attempt {} ({}): {}, {} iterations, misfit {:.4g}{}", made, attempt.name,
                                   estimator::name(one.estimate.status), one.estimate.iterations, one.misfit,
                                   one.start.follows ? ": explains the readings" : ""));
        if (best && !one.start.follows && !(one.misfit < best->misfit)) continue;
        best = one.start.follows ? run.with_signs_of_start(std::move(one)) : std::move(one);
        if (search.reached && std::isfinite(best->misfit)) search.reached(best->start.theta);
        if (best->start.follows) break;
    }
    if (!best && refused) throw *refused;
    SeriesStart start;
    if (best && (best->start.follows || (anything_followed(problem) && std::isfinite(best->misfit))))
        start = best->start;
    if (start.theta.size() == 0) start.theta = starts(parameters);
    start.attempts = made;
    start.iterations = iterations;
    start.evaluations = evaluations;
    return start;
}

}  // namespace orbid::identification
