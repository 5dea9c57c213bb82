#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <vector>

#include <tbb/parallel_for.h>
#include <Eigen/Core>
#include <Eigen/LU>

#include "models/system/system.hpp"
#include "orbits/cycles/cycle.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::tests {

/// The pendulum of the paper's simulations with its friction parameter k1 [N m]; g = 9.81 m/s^2.
inline Eigen::VectorXd pendulum_at(const models::System& pendulum, double k1) {
    Eigen::VectorXd theta = pendulum.default_parameters();
    theta[pendulum.parameter_index("k1")] = k1;
    theta[pendulum.parameter_index("g")] = 9.81;
    return theta;
}

/// Units of the pendulum's section: a turn, and the range of velocities on its attractor [rad/s].
inline Eigen::VectorXd pendulum_range() {
    Eigen::VectorXd range(2);
    range << 2.0 * 3.14159265358979323846, 29.3;
    return range;
}

/// Sections of the chaotic pendulum, 4 trajectories, normal reading errors of `noise` times pendulum_range().
inline orbits::Series pendulum_record(const models::System& pendulum, std::size_t sections, double noise,
                                      std::uint64_t seed) {
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SectionPlan{.sections = sections};
    options.trajectories = 4;
    options.seed = seed;
    if (noise > 0.0) options.noise = noise * pendulum_range();
    return simulate(pendulum, pendulum_at(pendulum, 0.0), options).series;
}

/// The encoder of the paper's experiment.
inline models::Sensor pendulum_encoder() {
    models::Sensor sensor;
    sensor.type = models::Sensor::Type::angle_difference;
    sensor.delay = 0.01508;
    sensor.step = 2.0 * 3.14159265358979323846 / 4096.0;
    sensor.rounding = models::Sensor::Rounding::nearest;
    return sensor;
}

/// Transients with dry friction (k1 = 1e-3), read through the encoder; a transient ends where the pendulum settles.
inline orbits::Series encoder_record(const models::System& pendulum, std::size_t sections, std::uint64_t seed) {
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SectionPlan{.sections = sections, .transient = 20};
    options.trajectories = 8;
    options.seed = seed;
    options.sensor = pendulum_encoder();
    return simulate(pendulum, pendulum_at(pendulum, 1e-3), options).series;
}

/// What a found cycle turned out to be.
struct CycleTruth {
    bool is_true = false;
    bool repeated = false;          ///< the model's orbit was already found by an earlier cycle of the list
    double position_error = 0.0;    ///< largest over points and coordinates, relative to the range
    double multiplier_error = 0.0;  ///< relative, of the largest
    Eigen::VectorXd z;              ///< errors of all coordinates over their sds, shape (n p)
    double ln_multiplier_z = 0.0;   ///< error of ln |largest multiplier| over its sd
    periodic::PeriodicOrbit orbit;  ///< of the model, in the order of the found points
};

/// What the sensor reads at states (shape (n, m)) of the section at phase 0.
inline Eigen::MatrixXd readings_at(const models::System& system, const Eigen::VectorXd& theta,
                                   const models::Sensor& sensor, const Eigen::MatrixXd& states) {
    const std::vector<double> phases(static_cast<std::size_t>(states.cols()), 0.0);
    return system.readings(sensor, states, phases, theta).readings;
}

/// States that a sensor reads as `readings` (shape (n, p)), by Newton's method with differences: what the model's
/// Newton starts from.
inline Eigen::MatrixXd states_behind(const models::System& system, const Eigen::VectorXd& theta,
                                     const models::Sensor& sensor, const Eigen::MatrixXd& readings) {
    Eigen::MatrixXd states = readings;
    const auto read = [&](const Eigen::MatrixXd& x) { return readings_at(system, theta, sensor, x); };
    for (int step = 0; step < 8; ++step) {
        const Eigen::MatrixXd now = read(states);
        for (Eigen::Index j = 0; j < states.cols(); ++j) {
            Eigen::MatrixXd slope(states.rows(), states.rows());
            for (Eigen::Index d = 0; d < states.rows(); ++d) {
                constexpr double h = 1e-5;
                Eigen::MatrixXd moved = states.col(j);
                moved(d, 0) += h;
                slope.col(d) = (read(moved) - now.col(j)) / h;
            }
            Eigen::VectorXd defect = readings.col(j) - now.col(j);
            for (Eigen::Index d = 0; d < defect.size(); ++d)
                if (system.coordinates()[static_cast<std::size_t>(d)].angle) defect[d] = models::wrapped(defect[d]);
            states.col(j) += slope.partialPivLu().solve(defect);
        }
    }
    return states;
}

/// A found cycle is true when the model's Newton, started at it, converges to a cycle of the same prime period and
/// rotation within max(0.1 % of the range, 4 of its own sds) at every point, each sd being below 2 % of the range.
///
/// @param range  shape (n): size of the attractor, a turn for angles.
/// @param sensor the readings that the cycles are made of; the model's orbit is read in the same way.
inline std::vector<CycleTruth> true_cycles(const models::System& system, const Eigen::VectorXd& theta,
                                           const std::vector<orbits::Cycle>& cycles, const Eigen::VectorXd& range,
                                           const std::optional<models::Sensor>& sensor = std::nullopt) {
    std::vector<CycleTruth> truths(cycles.size());
    tbb::parallel_for(std::size_t{0}, cycles.size(), [&](std::size_t i) {
        const orbits::Cycle& cycle = cycles[i];
        CycleTruth& truth = truths[i];
        const Eigen::MatrixXd start = sensor ? states_behind(system, theta, *sensor, cycle.points) : cycle.points;
        periodic::ShootingOptions options;
        options.scale = range;
        truth.orbit = solve_multiple_shooting(system, theta, 0.0, start, {}, {}, options);
        if (truth.orbit.status != periodic::OrbitStatus::converged) return;
        if (!cycle.rotation.empty() && cycle.rotation != truth.orbit.rotation) return;
        const Eigen::MatrixXd expected =
            sensor ? readings_at(system, theta, *sensor, truth.orbit.points) : truth.orbit.points;
        const Eigen::Index n = cycle.points.rows();
        truth.z.resize(cycle.points.size());
        truth.is_true = true;
        for (Eigen::Index k = 0; k < cycle.points.size(); ++k) {
            double error = cycle.points(k % n, k / n) - expected(k % n, k / n);
            if (system.coordinates()[static_cast<std::size_t>(k % n)].angle) error = models::wrapped(error);
            const double sd = std::sqrt(cycle.covariance(k, k));
            truth.z[k] = error / sd;
            truth.position_error = std::max(truth.position_error, std::abs(error) / range[k % n]);
            if (!(std::abs(error) <= std::max(1e-3 * range[k % n], 4.0 * sd)) || !(sd < 0.02 * range[k % n]))
                truth.is_true = false;
        }
        const auto exact = truth.orbit.multipliers.front();
        truth.multiplier_error = std::abs(cycle.multipliers.front() / exact - 1.0);
        truth.ln_multiplier_z =
            (cycle.ln_multiplier[0] - std::log(std::abs(exact))) / std::sqrt(cycle.ln_multiplier_covariance(0, 0));
    });
    // Two cycles of the list must not be one orbit of the model.
    for (std::size_t i = 0; i < truths.size(); ++i)
        for (std::size_t k = 0; k < i && truths[i].is_true; ++k) {
            if (!truths[k].is_true || cycles[k].period != cycles[i].period) continue;
            const Eigen::Index p = cycles[i].period;
            for (Eigen::Index shift = 0; shift < p; ++shift) {
                double distance = 0.0;
                for (Eigen::Index j = 0; j < p; ++j)
                    for (Eigen::Index d = 0; d < range.size(); ++d) {
                        double apart = truths[i].orbit.points(d, j) - truths[k].orbit.points(d, (j + shift) % p);
                        if (system.coordinates()[static_cast<std::size_t>(d)].angle) apart = models::wrapped(apart);
                        distance = std::max(distance, std::abs(apart) / range[d]);
                    }
                if (distance < 1e-7) {
                    truths[i].repeated = true;
                    truths[i].is_true = false;
                }
            }
        }
    return truths;
}

/// Figures of one period of a search, or of all.
struct TruthSummary {
    std::size_t found = 0, true_ones = 0, repeated = 0;
    double median_position = 0.0, worst_position = 0.0;      ///< relative to the range, true cycles only
    double median_multiplier = 0.0, worst_multiplier = 0.0;  ///< relative
    double z_rms = 0.0, z_largest = 0.0;                     ///< over the coordinates that are not exactly known
    double ln_multiplier_z_rms = 0.0;
};

/// @param period  0: all periods.
inline TruthSummary summary(const std::vector<orbits::Cycle>& cycles, const std::vector<CycleTruth>& truths,
                            int period) {
    TruthSummary result;
    std::vector<double> positions, multipliers;
    double squares = 0.0, count = 0.0, multiplier_squares = 0.0;
    for (std::size_t i = 0; i < cycles.size(); ++i) {
        if (period != 0 && cycles[i].period != period) continue;
        ++result.found;
        if (truths[i].repeated) ++result.repeated;
        if (!truths[i].is_true) continue;
        ++result.true_ones;
        multipliers.push_back(truths[i].multiplier_error);
        multiplier_squares += truths[i].ln_multiplier_z * truths[i].ln_multiplier_z;
        // Fixed points that are their own mirror image are known by symmetry, without error.
        if (cycles[i].period == 1 && cycles[i].mirror == i) continue;
        positions.push_back(truths[i].position_error);
        squares += truths[i].z.squaredNorm();
        count += static_cast<double>(truths[i].z.size());
        result.z_largest = std::max(result.z_largest, truths[i].z.cwiseAbs().maxCoeff());
    }
    std::sort(positions.begin(), positions.end());
    std::sort(multipliers.begin(), multipliers.end());
    if (!positions.empty()) {
        result.median_position = positions[positions.size() / 2];
        result.worst_position = positions.back();
        result.z_rms = std::sqrt(squares / count);
    }
    if (!multipliers.empty()) {
        result.median_multiplier = multipliers[multipliers.size() / 2];
        result.worst_multiplier = multipliers.back();
        result.ln_multiplier_z_rms = std::sqrt(multiplier_squares / static_cast<double>(multipliers.size()));
    }
    return result;
}

}  // namespace orbid::tests
