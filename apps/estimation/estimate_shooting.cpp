#include "apps/estimation/estimate_shooting.hpp"

#include <stdexcept>

#include <fmt/format.h>

#include "apps/estimation/estimated_values.hpp"
#include "apps/job/segment_choice.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::apps {

namespace {

// Of all experiments together: enough that a parameter with 1 % of the information is found to a few percent, and
// cheap beside every later stage.
constexpr std::size_t predicted_intervals = 2000;
// The next stage moves the parameters again.
constexpr int prediction_iterations = 60;
constexpr double prediction_tolerance = 1e-2;

/// Range of every coordinate of the model, as far as the readings tell it.
Eigen::VectorXd model_range(const models::System& system, const orbits::Series& series) {
    return orbits::coordinate_range(system, series, Eigen::MatrixXd::Zero(system.dimension(), 0));
}

orbits::Continuity matching(const Job& job, const DataJob& data, const orbits::Series& series) {
    const MatchingJob& asked = job.estimate->series->matching;
    orbits::Continuity result;
    // A simulated record follows its equations; a measured one only as far as the model is right.
    const bool perfect = asked.kind == MatchingJob::Kind::exact ||
                         (asked.kind == MatchingJob::Kind::automatic && data.simulation.has_value());
    result.kind = perfect ? orbits::Continuity::Kind::exact : orbits::Continuity::Kind::normal;
    result.estimate = !perfect && asked.kind != MatchingJob::Kind::given;
    if (asked.kind == MatchingJob::Kind::given) result.sd = asked.sd * model_range(*job.model.system, series);
    return result;
}

orbits::ShootingOptions shooting_options(const Job& job, std::size_t experiment, const orbits::Series& series,
                                         const Eigen::VectorXd& start) {
    const SeriesResidualJob& asked = *job.estimate->series;
    const DataJob& data = job.data[experiment];
    orbits::ShootingOptions options;
    options.name = asked.data.size() > 1 ? "series." + data.name : "series";
    options.sensor = data.sensor;
    for (const Eigen::Index coordinate : data.observe) {
        options.observe.emplace_back(job.model.coordinate(coordinate).name);
        // A rate that is a difference of two readings has the errors of the angle.
        const bool second = data.sensor.type == models::Sensor::Type::angle_difference &&
                            coordinate == static_cast<Eigen::Index>(data.sensor.rate);
        const Eigen::Index own = second ? static_cast<Eigen::Index>(data.sensor.angle) : coordinate;
        for (const ErrorJob& error : asked.errors) {
            if (error.coordinate != own) continue;
            options.errors.push_back(error.scale);
            options.forms.push_back(error_form(error));
        }
    }
    options.segments = fitted_segments(series, data);
    options.matching = matching(job, data, series);
    options.interval = static_cast<Eigen::Index>(asked.interval.value_or(SeriesResidualJob::automatic_interval));
    options.start = start;
    return options;
}

/// @param experiments  among which the intervals that are predicted are divided.
std::unique_ptr<orbits::PredictionResidual> prediction_residual(const Job& job, std::size_t experiment,
                                                                const Experiment& measured,
                                                                const models::ParameterBinding& binding,
                                                                const Eigen::VectorXd& theta, std::size_t experiments) {
    const DataJob& data = job.data[experiment];
    const orbits::Series& series = measured.series;
    const models::System& system = *job.model.system;
    auto systems = systems_with(job, measured.inputs);
    try {
        const auto segments = fitted_segments(series, data);
        const Eigen::VectorXd values = binding.values(theta);
        const Eigen::Index interval = orbits::shooting_interval(systems, values, series, data.sensor, segments);
        auto list = orbits::transitions(systems, values, series, data.sensor, segments, interval,
                                        predicted_intervals / experiments, job.seed);
        Eigen::MatrixXd states(system.dimension(), static_cast<Eigen::Index>(list.size()));
        for (Eigen::Index i = 0; i < states.cols(); ++i)
            states.col(i) = list[static_cast<std::size_t>(i)].from;
        orbits::PredictionOptions options;
        if (experiments > 1) options.name = "prediction." + data.name;
        options.sizes = orbits::error_sizes(data.sensor, orbits::coordinate_range(system, series, states));
        return std::make_unique<orbits::PredictionResidual>(std::move(systems), binding, std::move(list),
                                                            orbits::transition_clock(system, series), theta,
                                                            std::move(options));
    } catch (const std::invalid_argument& error) {
        throw orbits::DataError(fmt::format("{}: {}", data.name, error.what()));
    }
}

}  // namespace

void add_shooting(const Job& job, const std::vector<Experiment>& data, const EstimateSetup& setup,
                  const Eigen::VectorXd& start, const std::vector<std::vector<Eigen::MatrixXd>>& nodes,
                  JobResiduals& residuals) {
    const auto& experiments = job.estimate->series->data;
    for (std::size_t i = 0; i < experiments.size(); ++i) {
        const std::size_t experiment = experiments[i];
        const Experiment& measured = data[experiment];
        orbits::ShootingOptions options = shooting_options(job, experiment, measured.series, start);
        options.inputs = measured.inputs;
        if (!nodes.empty()) options.nodes = nodes.at(i);
        try {
            residuals.shooting.push_back(std::make_unique<orbits::ShootingResidual>(
                job.model.system, setup.experiments[experiment], measured.series, std::move(options)));
        } catch (const std::invalid_argument& error) {
            throw orbits::DataError(fmt::format("{}: {}", job.data[experiment].name, error.what()));
        }
        residuals.shooting_experiments.push_back(experiment);
    }
}

PredictionStart prediction_start(const Job& job, const std::vector<Experiment>& data, const EstimateSetup& setup,
                                 const models::ParameterBinding& cycle_binding,
                                 const std::vector<estimator::FreeParameter>& parameters,
                                 const Eigen::VectorXd* known) {
    const bool of_series = job.estimate->series && !job.estimate->series->data.empty();
    const auto experiments = of_series ? job.estimate->series->data : std::vector<std::size_t>{job.orbits->data};
    PredictionStart result;
    result.theta = column(parameters, &estimator::FreeParameter::start);
    const auto make = [&](const Eigen::VectorXd& theta) {
        std::vector<std::unique_ptr<orbits::PredictionResidual>> list;
        for (const std::size_t experiment : experiments) {
            const models::ParameterBinding& binding = of_series ? setup.experiments[experiment] : cycle_binding;
            list.push_back(prediction_residual(job, experiment, data[experiment], binding, theta, experiments.size()));
        }
        return list;
    };
    if (known != nullptr) result.theta = *known;
    result.residuals.prediction = make(result.theta);
    if (known != nullptr || !job.estimate->scan) return result;
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

}  // namespace orbid::apps
