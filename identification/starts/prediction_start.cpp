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

// Of all experiments together, and cheap beside every later stage. Of 53 chaotic systems 500 solved as many as 2000, at
// errors of 1 % and of 5 %.
constexpr std::size_t predicted_intervals = 500;
// The next stage moves the parameters again.
constexpr int prediction_iterations = 60;
constexpr double prediction_tolerance = 0.1;  // of sds: errors of the readings bias it by more

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
