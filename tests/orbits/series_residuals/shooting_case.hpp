#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/series_residuals/prediction_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::tests {

/// All parameters named are estimated, in this order; the others keep the values of base.
inline models::ParameterBinding bound(const models::System& system, const Eigen::VectorXd& base,
                                      const std::vector<std::string>& names) {
    models::ParameterBinding b;
    b.base = base;
    for (const std::string& name : names) {
        b.parameter.push_back(system.parameter_index(name));
        b.estimated.push_back(b.estimated_count++);
    }
    return b;
}

/// Estimated parameters of a binding at their base values.
inline Eigen::VectorXd base_theta(const models::ParameterBinding& b) {
    Eigen::VectorXd theta(b.estimated_count);
    for (std::size_t j = 0; j < b.parameter.size(); ++j)
        theta[b.estimated[j]] = b.base[b.parameter[j]];
    return theta;
}

inline models::Sensor encoder(double step) {
    models::Sensor sensor;
    sensor.type = models::Sensor::Type::angle_difference;
    sensor.delay = 0.01508;
    sensor.step = step;
    sensor.rounding = step > 0.0 ? models::Sensor::Rounding::nearest : models::Sensor::Rounding::none;
    return sensor;
}

/// Sections of the pendulum with dry friction, read by an encoder.
struct PendulumCase {
    std::shared_ptr<const models::System> system = models::make_system("parametric_pendulum");
    Eigen::VectorXd base;
    models::Sensor sensor;
    orbits::Series series;

    PendulumCase(std::size_t sections, const models::Sensor& read_by, std::uint64_t seed = 1)
        : base(system->default_parameters()), sensor(read_by) {
        base[system->parameter_index("k1")] = 1e-3;
        orbits::VirtualExperimentOptions options;
        options.plan = orbits::SectionPlan{sections, 20, {}, 0.0};
        options.sensor = sensor;
        options.seed = seed;
        series = orbits::simulate(*system, base, options).series;
    }
};

/// Largest difference of the derivatives from central differences, relative to the largest derivative of the column.
/// Latent states are moved all at once in directions that are zero but in every third block, so that a link's
/// derivatives with respect to both of its nodes are seen.
inline double derivative_error(const orbits::ShootingResidual& residual, const Eigen::VectorXd& theta,
                               const std::vector<Eigen::VectorXd>& latents) {
    const auto values = residual.evaluate(residual.initial_set(), theta, latents, true);
    double worst = 0.0;
    const auto all = [](const estimator::BlockValue& value) {
        Eigen::VectorXd stacked(value.e.size() + value.c.size());
        stacked << value.e, value.c;
        return stacked;
    };
    const auto compare = [&](const Eigen::VectorXd& column, const Eigen::VectorXd& difference) {
        worst = std::max(
            worst, (column - difference).cwiseAbs().maxCoeff() / std::max(1e-3, difference.cwiseAbs().maxCoeff()));
    };
    for (Eigen::Index j = 0; j < theta.size(); ++j) {
        const double h = 1e-5 * std::max(std::abs(theta[j]), 1e-3);
        Eigen::VectorXd above = theta, below = theta;
        above[j] += h;
        below[j] -= h;
        const auto high = residual.evaluate(residual.initial_set(), above, latents, false);
        const auto low = residual.evaluate(residual.initial_set(), below, latents, false);
        for (std::size_t b = 0; b < values.size(); ++b) {
            Eigen::VectorXd column(values[b].e.size() + values[b].c.size());
            column << values[b].e_theta.col(j),
                Eigen::VectorXd(values[b].c.size() > 0 ? values[b].c_theta.col(j) : Eigen::VectorXd(0));
            compare(column, (all(high[b]) - all(low[b])) / (2.0 * h));
        }
    }
    const Eigen::Index n = latents.front().size();
    for (std::size_t phase = 0; phase < 3; ++phase)
        for (Eigen::Index i = 0; i < n; ++i) {
            constexpr double h = 1e-6;
            auto above = latents, below = latents;
            for (std::size_t b = phase; b < latents.size(); b += 3) {
                above[b][i] += h;
                below[b][i] -= h;
            }
            const auto high = residual.evaluate(residual.initial_set(), theta, above, false);
            const auto low = residual.evaluate(residual.initial_set(), theta, below, false);
            for (std::size_t b = 0; b < values.size(); ++b) {
                Eigen::VectorXd column = Eigen::VectorXd::Zero(values[b].e.size() + values[b].c.size());
                const Eigen::Index c = values[b].c.size();
                const bool next_moves = b + 1 < values.size() && (b + 1) % 3 == phase;
                if (b % 3 == phase) {
                    column.head(values[b].e.size()) = values[b].e_z.col(i);
                    if (c > 0) column.tail(c) = values[b].c_z.col(i);
                } else if (next_moves) {
                    if (values[b].e_next.size() > 0) column.head(values[b].e.size()) = values[b].e_next.col(i);
                    if (c > 0) column.tail(c) = values[b].c_next.col(i);
                } else {
                    continue;
                }
                compare(column, (all(high[b]) - all(low[b])) / (2.0 * h));
            }
        }
    return worst;
}

}  // namespace orbid::tests
