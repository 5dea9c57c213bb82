#include <cmath>
#include <numeric>
#include <span>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Core>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/stored_run/forecast.hpp"
#include "estimator/interface/not_finite.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::apps::detail {

namespace {

/// Sums over all steps.
struct StepSums {
    std::vector<double> squares;   ///< of the errors of each coordinate
    std::vector<double> expected;  ///< of their variances
    double normalised = 0.0;
    double growth = 0.0;
};

/// Sds of readings as the run knows them; otherwise what these very predictions leave, an upper bound.
Eigen::VectorXd reading_sds(const PredictionJob& job, const std::vector<orbits::Prediction>& predicted,
                            const Eigen::VectorXd& sizes, Forecast& out) {
    Eigen::VectorXd sds = Eigen::VectorXd::Constant(sizes.size(), estimator::nan_value);
    if (job.known_errors && job.derived.estimate && job.derived.estimate->series) {
        for (const ErrorJob& error : job.derived.estimate->series->errors)
            sds[error.coordinate] = error.scale.value > 0.0 ? error.scale.value : estimator::nan_value;
    }
    if (sds.allFinite()) return sds;
    out.known_errors = false;
    return orbits::prediction_noise(predicted, sizes).cwiseProduct(sizes);
}

}  // namespace

void forecast_sections(const PredictionJob& job, const Experiment& record, Forecast& out) {
    const models::System& system = *job.derived.model.system;
    const DataJob& data = job.derived.data[0];
    const auto systems = identification::systems_with(job.derived.model.system, record.inputs);
    const Eigen::VectorXd values = data.with_own(job.derived.model.values);
    std::vector<std::size_t> segments(record.series.segments.size());
    std::iota(segments.begin(), segments.end(), std::size_t{0});
    constexpr std::size_t most = 100000;  // steps: an rms to a quarter of a percent
    const auto steps =
        orbits::transitions(systems, values, record.series, data.sensor, segments, 1, most, job.derived.seed);
    if (steps.empty()) throw orbits::DataError(fmt::format("{}: no reading has a successor", data.name));
    const models::FlowOptions flow{1e-10, 1e-10, 20000};
    const auto predicted = orbits::predictions(systems, values, steps, std::span<const Eigen::Index>{},
                                               orbits::transition_clock(system, record.series), flow);
    Eigen::MatrixXd states(system.dimension(), static_cast<Eigen::Index>(steps.size()));
    for (Eigen::Index k = 0; k < states.cols(); ++k)
        states.col(k) = steps[static_cast<std::size_t>(k)].from;
    const Eigen::VectorXd sizes =
        orbits::error_sizes(data.sensor, orbits::coordinate_range(system, record.series, states));
    const Eigen::VectorXd sds = reading_sds(job, predicted, sizes, out);

    StepForecast& all = out.steps;
    const auto dimension = static_cast<std::size_t>(system.dimension());
    StepSums sums{std::vector<double>(dimension, 0.0), std::vector<double>(dimension, 0.0)};
    for (std::size_t k = 0; k < predicted.size(); ++k) {
        if (!predicted[k].ok) {
            ++all.failed;
            continue;
        }
        ++all.steps;
        sums.growth += std::log(models::singular_values(predicted[k].by_x)[0]);
        for (Eigen::Index i = 0; i < system.dimension(); ++i) {
            const auto c = static_cast<std::size_t>(i);
            const double error = predicted[k].error[i];
            const double variance =
                sds[i] * sds[i] + predicted[k].by_x.row(i).cwiseProduct(sds.transpose()).squaredNorm();
            sums.squares[c] += error * error;
            sums.expected[c] += variance;
            sums.normalised += error * error / variance;
            out.rows.push_back({data.name, record.series.segments[steps[k].segment].label,
                                std::string(system.coordinates()[c].name), static_cast<double>(k), steps[k].to[i],
                                steps[k].to[i] - error, std::sqrt(variance)});
        }
    }
    for (std::size_t c = 0; c < dimension; ++c) {
        const auto& coordinate = system.coordinates()[c];
        all.coordinates.push_back({std::string(coordinate.name), std::string(coordinate.unit),
                                   root_mean_square(sums.squares[c], all.steps), sds[static_cast<Eigen::Index>(c)]});
        all.expected.push_back(root_mean_square(sums.expected[c], all.steps));
    }
    all.normalised = root_mean_square(sums.normalised, all.steps * dimension);
    if (all.steps > 0) all.growth = sums.growth / static_cast<double>(all.steps);
}

}  // namespace orbid::apps::detail
