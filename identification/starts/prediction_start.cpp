#include "identification/starts/prediction_start.hpp"

#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/state_track.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::identification {

namespace {

// Of all experiments together: enough that a parameter with 1 % of the information is found to a few percent, and
// cheap beside every later stage.
constexpr std::size_t predicted_intervals = 2000;
// The next stage moves the parameters again.
constexpr int prediction_iterations = 60;
constexpr double prediction_tolerance = 1e-2;

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

orbits::ShootingOptions shooting_options(const IdentificationProblem& problem, std::size_t experiment,
                                         const Eigen::VectorXd& start) {
    const SeriesChoice& asked = *problem.series;
    const Experiment& data = problem.experiments[experiment];
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
    options.interval = static_cast<Eigen::Index>(asked.interval.value_or(SeriesChoice::automatic_interval));
    options.start = start;
    options.first_state = first_state(data);
    return options;
}

/// @param experiments  among which the intervals that are predicted are divided.
std::unique_ptr<orbits::PredictionResidual> prediction_residual(const IdentificationProblem& problem,
                                                                std::size_t experiment,
                                                                const models::ParameterBinding& binding,
                                                                const Eigen::VectorXd& theta, std::size_t experiments,
                                                                std::uint64_t seed) {
    const Experiment& data = problem.experiments[experiment];
    const models::System& system = *problem.system;
    orbits::Series delayed;  // a later input is an earlier clock
    if (data.delay) {
        delayed = *data.series;
        delayed.phase -= binding.values(theta)[*data.delay];
    }
    const orbits::Series& series = data.delay ? delayed : *data.series;
    auto systems = systems_with(problem.system, data.inputs);
    try {
        const auto segments = data.fitted_segments();
        const Eigen::VectorXd values = binding.values(theta);
        const auto known = orbits::followed_series(systems, values, series, data.sensor, segments);
        const Eigen::Index interval = orbits::shooting_interval(systems, values, series, data.sensor, segments, known);
        auto list = orbits::transitions(systems, values, series, data.sensor, segments, interval,
                                        predicted_intervals / experiments, seed, known);
        Eigen::MatrixXd states(system.dimension(), static_cast<Eigen::Index>(list.size()));
        for (Eigen::Index i = 0; i < states.cols(); ++i)
            states.col(i) = list[static_cast<std::size_t>(i)].from;
        orbits::PredictionOptions options;
        options.delay = data.delay;
        if (data.delay)
            for (orbits::Transition& one : list)
                one.phase += values[*data.delay];
        if (experiments > 1) options.name = "prediction." + data.name;
        options.sizes = orbits::error_sizes(data.sensor, orbits::coordinate_range(system, series, states));
        return std::make_unique<orbits::PredictionResidual>(std::move(systems), binding, std::move(list),
                                                            orbits::transition_clock(system, series), theta,
                                                            std::move(options));
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: {}", data.name, error.what()));
    }
}

}  // namespace

void add_shooting(const IdentificationProblem& problem, const EstimateSetup& setup, const Eigen::VectorXd& start,
                  const std::vector<std::vector<Eigen::MatrixXd>>& nodes, ProblemResiduals& residuals) {
    const auto& experiments = problem.series->data;
    for (std::size_t i = 0; i < experiments.size(); ++i) {
        const std::size_t experiment = experiments[i];
        const Experiment& measured = problem.experiments[experiment];
        orbits::ShootingOptions options = shooting_options(problem, experiment, start);
        options.inputs = measured.inputs;
        options.delay = setup.delay(measured, experiment);
        if (!nodes.empty()) options.nodes = nodes.at(i);
        try {
            residuals.shooting.push_back(std::make_unique<orbits::ShootingResidual>(
                problem.system, setup.experiments[experiment], *measured.series, std::move(options)));
        } catch (const orbits::DataError& error) {
            throw orbits::DataError(fmt::format("{}: {}", problem.experiments[experiment].name, error.what()));
        }
        residuals.shooting_experiments.push_back(experiment);
    }
}

PredictionStart prediction_start(const IdentificationProblem& problem, const Options& options,
                                 const EstimateSetup& setup, const models::ParameterBinding& cycle_binding,
                                 const std::vector<estimator::FreeParameter>& parameters,
                                 const Eigen::VectorXd* known) {
    const bool of_series = problem.series && !problem.series->data.empty();
    const auto experiments = of_series ? problem.series->data : std::vector<std::size_t>{*problem.measured.experiment};
    PredictionStart result;
    result.theta = column(parameters, &estimator::FreeParameter::start);
    const auto make = [&](const Eigen::VectorXd& theta) {
        std::vector<std::unique_ptr<orbits::PredictionResidual>> list;
        for (const std::size_t experiment : experiments) {
            const models::ParameterBinding& binding = of_series ? setup.experiments[experiment] : cycle_binding;
            list.push_back(prediction_residual(problem, experiment, binding, theta, experiments.size(), options.seed));
        }
        return list;
    };
    if (known != nullptr) result.theta = *known;
    result.residuals.prediction = make(result.theta);
    if (known != nullptr || !options.scan) return result;
    const auto misfit = [&](const Eigen::VectorXd& theta) {
        double sum = 0.0;
        for (const auto& residual : result.residuals.prediction)
            sum += residual->misfit(theta);
        return sum;
    };
    result.theta = orbits::scanned_start(misfit, result.theta, column(parameters, &estimator::FreeParameter::lower),
                                         column(parameters, &estimator::FreeParameter::upper),
                                         column(parameters, &estimator::FreeParameter::typical_size));
    // Weights are those of the parameters at hand.
    result.residuals.prediction = make(result.theta);
    return result;
}

estimator::EstimateOptions prediction_options(const estimator::EstimateOptions& options) {
    estimator::EstimateOptions quick = options;
    quick.variance = estimator::Variance::ml;
    quick.verdict = false;
    quick.maximum_iterations = prediction_iterations;
    quick.step_tolerance = prediction_tolerance;
    return quick;
}

}  // namespace orbid::identification
