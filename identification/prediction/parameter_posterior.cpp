#include "identification/prediction/parameter_posterior.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "estimator/interface/random_stream.hpp"
#include "estimator/problem/coordinate.hpp"
#include "models/arithmetic/eigenvalues.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Tries per draw, before the estimate counts as lying at a bound.
constexpr std::size_t most_tries = 1000;

bool is_held(const std::vector<Index>& held, Index parameter) {
    return std::find(held.begin(), held.end(), parameter) != held.end();
}

bool is_allowed(const models::System& system, const ParameterPosterior& posterior, const VectorXd& values) {
    for (std::size_t i = 0; i < posterior.parameters.size(); ++i) {
        const double value = values(posterior.parameters[i]);
        const auto& parameter = system.parameters()[static_cast<std::size_t>(posterior.parameters[i])];
        const estimator::FreeParameter& free = posterior.estimated[i];
        if (!(value >= free.lower && value <= free.upper) || !models::contains(parameter.domain, value)) return false;
    }
    return true;
}

ParameterDraws from_sample(const ParameterPosterior& posterior, std::size_t count, const std::vector<Index>& held) {
    ParameterDraws draws;
    draws.from_sample = true;
    const auto available = static_cast<std::size_t>(posterior.sample.cols());
    count = std::min(count, available);
    draws.values = posterior.values.replicate(1, static_cast<Index>(count));
    for (std::size_t k = 0; k < count; ++k) {
        // In the middle of equal shares: all chains count alike.
        const auto from = static_cast<Index>((2 * k + 1) * available / (2 * count));
        for (std::size_t i = 0; i < posterior.parameters.size(); ++i)
            if (!is_held(held, posterior.parameters[i]))
                draws.values(posterior.parameters[i], static_cast<Index>(k)) =
                    posterior.sample(static_cast<Index>(i), from);
    }
    return draws;
}

}  // namespace

FreeCovariance free_covariance(const ParameterPosterior& posterior, const std::vector<Index>& held) {
    FreeCovariance free;
    std::vector<Index> rows;
    for (std::size_t i = 0; i < posterior.parameters.size(); ++i) {
        if (is_held(held, posterior.parameters[i])) continue;
        free.parameters.push_back(posterior.parameters[i]);
        rows.push_back(static_cast<Index>(i));
    }
    if (posterior.covariance.size() > 0) free.covariance = posterior.covariance(rows, rows);
    return free;
}

ParameterDraws draw_parameters(const models::System& system, const ParameterPosterior& posterior, std::size_t count,
                               std::uint64_t seed, const std::vector<Index>& held) {
    if (posterior.sample.size() > 0) return from_sample(posterior, count, held);
    const FreeCovariance free = free_covariance(posterior, held);
    if (free.covariance.size() == 0 && !free.parameters.empty())
        throw std::invalid_argument("the estimate has neither a covariance nor a posterior sample");
    const auto f = std::ssize(free.parameters);
    std::vector<estimator::Coordinate> coordinates;
    VectorXd mean(f), slope(f);
    for (std::size_t i = 0, k = 0; i < posterior.parameters.size(); ++i) {
        if (is_held(held, posterior.parameters[i])) continue;
        coordinates.push_back(estimator::coordinate_of(posterior.estimated[i]));
        const double value = posterior.values(posterior.parameters[i]);
        mean(static_cast<Index>(k)) = coordinates.back().at(value);
        slope(static_cast<Index>(k)) = coordinates.back().slope(value);
        ++k;
    }
    const VectorXd inverse = slope.cwiseInverse();
    const MatrixXd covariance = inverse.asDiagonal() * free.covariance * inverse.asDiagonal();
    if (!mean.allFinite() || !covariance.allFinite())
        throw std::invalid_argument("an estimate lies at the end of its scale, where it has no normal approximation");
    MatrixXd factor(f, f);
    if (f > 0) {
        const models::SymmetricEigen eigen = models::symmetric_eigen(covariance);
        factor = eigen.vectors * eigen.values.cwiseMax(0.0).cwiseSqrt().asDiagonal();
    }
    ParameterDraws draws;
    draws.values = posterior.values.replicate(1, static_cast<Index>(count));
    for (std::size_t k = 0; k < count; ++k) {
        estimator::RandomStream stream(seed, estimator::RandomPurpose::prediction_draw, k);
        VectorXd values = posterior.values;
        std::size_t tries = 0;
        do {
            if (++tries > most_tries)
                throw std::invalid_argument(
                    "the normal approximation lies outside the bounds or domains of the parameters");
            VectorXd x(f);
            for (Index i = 0; i < f; ++i)
                x(i) = stream.normal();
            const VectorXd u = mean + factor * x;
            for (Index i = 0; i < f; ++i)
                values(free.parameters[static_cast<std::size_t>(i)]) =
                    coordinates[static_cast<std::size_t>(i)].natural(u(i));
        } while (!is_allowed(system, posterior, values));
        draws.outside += tries - 1;
        draws.values.col(static_cast<Index>(k)) = values;
    }
    return draws;
}

}  // namespace orbid::identification
