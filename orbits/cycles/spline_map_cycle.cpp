#include "orbits/cycles/spline_map_cycle.hpp"

#include <cmath>

#include "models/arithmetic/lu_factor.hpp"
#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/local_maps/local_map.hpp"

namespace orbid::orbits {
namespace {

// Largest coordinate of a Newton step: a patch is about as wide.
constexpr double spline_step_cap = 0.04;

// Newton has converged when its step is down to rounding. From far starts it walks: 0.2 away is five capped steps.
constexpr double converged_spline_step = 1e-12;
constexpr int most_spline_steps = 40;

// Errors of the map at a cycle's points by those of its coefficients, K' z with independent z: of each point the value,
// then the columns of the jacobian. Shape (entries, coefficients).
Eigen::MatrixXd coefficient_errors(const SplineMapFit& fit, const Eigen::MatrixXd& points,
                                   const std::vector<MapValue>& values) {
    const Eigen::Index n = points.rows(), p = points.cols(), entries = n * (n + 1);
    const auto size = static_cast<std::size_t>(fit.map.basis().unknowns());
    // rows: root (value and jacobian entries of all points)', one column per entry
    Eigen::MatrixXd image = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(size), entries * p);
    for (Eigen::Index j = 0; j < p; ++j) {
        const SplineSupport& support = values[static_cast<std::size_t>(j)].support;
        for (std::size_t f = 0; f < support.patch.size(); ++f)
            for (Eigen::Index d = 0; d < n; ++d) {
                const auto unknown = static_cast<std::size_t>(support.patch[f] * n + d);
                if (fit.map.basis().fixed()[unknown]) continue;
                const auto column = static_cast<Eigen::Index>(f);
                const double sign = fit.map.sign(support.mirrored[f] != 0, d);
                for (std::size_t i = unknown; i < size; ++i) {
                    const double root = sign * fit.root[i * size + unknown];
                    const auto row = static_cast<Eigen::Index>(i);
                    image(row, j * entries + d) += root * support.value[column];
                    for (Eigen::Index a = 0; a < n; ++a)
                        image(row, j * entries + n + a * n + d) += root * support.slope(a, column);
                }
            }
    }
    return image.transpose();
}

// Covariance of the same errors, with that of what the patches do not represent.
Eigen::MatrixXd map_errors(const SplineMapFit& fit, const Eigen::MatrixXd& points, const Eigen::MatrixXd& image) {
    const Eigen::Index n = points.rows(), p = points.cols(), entries = n * (n + 1);
    Eigen::MatrixXd errors = image * image.transpose();
    for (Eigen::Index j = 0; j < p; ++j) {
        const Eigen::VectorXd& missed = fit.model_error.variance(fit.map.basis(), points.col(j).data());
        for (Eigen::Index d = 0; d < n; ++d) {
            errors(j * entries + d, j * entries + d) += missed[d];
            for (Eigen::Index a = 0; a < n; ++a) {
                const Eigen::Index entry = j * entries + n + a * n + d;
                errors(entry, entry) += missed[d] / std::pow(fit.map.basis().spacing(a), 2);
            }
        }
    }
    return errors;
}

}  // namespace

SplineMapCycle close_on_spline_map(const SectionPoints& section, const SplineMap& map, const Eigen::MatrixXd& start) {
    const Eigen::Index n = start.rows(), p = start.cols();
    SplineMapCycle cycle{start, false};
    Eigen::VectorXd defect(n * p);
    Eigen::MatrixXd matrix(n * p, n * p);
    MapValue value;
    for (int step = 0; step < most_spline_steps; ++step) {
        matrix.setZero();
        for (Eigen::Index j = 0; j < p; ++j) {
            map.evaluate(cycle.points.col(j).data(), 1, value);
            if (!value.inside) return cycle;
            matrix.block(j * n, j * n, n, n) += value.jacobian;
            matrix.block(j * n, ((j + 1) % p) * n, n, n) -= Eigen::MatrixXd::Identity(n, n);
            for (Eigen::Index d = 0; d < n; ++d)
                defect[j * n + d] =
                    section.difference(cycle.points(d, j) + value.displacement[d], cycle.points(d, (j + 1) % p), d);
        }
        Eigen::VectorXd change = models::LuFactor(matrix).solve(Eigen::VectorXd(-defect));
        if (!change.allFinite()) return cycle;
        const double size = change.cwiseAbs().maxCoeff();
        if (size > spline_step_cap) change *= spline_step_cap / size;
        for (Eigen::Index j = 0; j < p; ++j)
            cycle.points.col(j) = section.wrapped(cycle.points.col(j) + change.segment(j * n, n));
        if (size < converged_spline_step) {
            cycle.converged = true;
            return cycle;
        }
    }
    return cycle;
}

CycleMultipliers multipliers_of(const SplineMap& map, const Eigen::MatrixXd& points) {
    std::vector<Eigen::MatrixXd> jacobians;
    MapValue value;
    for (Eigen::Index j = 0; j < points.cols(); ++j) {
        map.evaluate(points.col(j).data(), 1, value);
        jacobians.push_back(value.jacobian);
    }
    return cycle_multipliers(jacobians);
}

CycleCandidate draft_of(const SectionPoints& section, const SplineMapFit& fit, const Eigen::MatrixXd& points) {
    const Eigen::Index n = points.rows(), p = points.cols(), entries = n * (n + 1);
    std::vector<Eigen::MatrixXd> jacobians;
    std::vector<MapValue> values(static_cast<std::size_t>(p));
    Eigen::VectorXd turns = Eigen::VectorXd::Zero(n);
    for (Eigen::Index j = 0; j < p; ++j) {
        MapValue& value = values[static_cast<std::size_t>(j)];
        fit.map.evaluate(points.col(j).data(), 2, value);
        jacobians.push_back(value.jacobian);
        turns += value.displacement;
    }
    const Eigen::MatrixXd image = coefficient_errors(fit, points, values);
    const Eigen::MatrixXd errors = map_errors(fit, points, image);

    CycleCandidate draft;
    draft.points = points;
    draft.multipliers = cycle_multipliers(jacobians);
    const Eigen::MatrixXd inverse = -models::inverse(coupled_matrix(jacobians));
    const Eigen::MatrixXd derivative = ln_multiplier_derivative(jacobians);
    Eigen::MatrixXd to_points = Eigen::MatrixXd::Zero(n * p, entries * p);
    for (Eigen::Index j = 0; j < p; ++j)
        to_points.middleCols(j * entries, n) = inverse.middleCols(j * n, n);
    Eigen::MatrixXd to_multipliers = Eigen::MatrixXd::Zero(n, entries * p);
    for (Eigen::Index j = 0; j < p; ++j) {
        const Eigen::MatrixXd direct = derivative.middleCols(j * n * n, n * n);
        to_multipliers.middleCols(j * entries + n, n * n) += direct;
        Eigen::MatrixXd bend(n * n, n);  // d vec(A_j) / d x_j
        for (Eigen::Index a = 0; a < n; ++a)
            for (Eigen::Index d = 0; d < n; ++d)
                bend.row(a * n + d) = values[static_cast<std::size_t>(j)].bending[static_cast<std::size_t>(d)].row(a);
        to_multipliers += direct * bend * to_points.middleRows(j * n, n);
    }
    draft.covariance = floored_covariance(to_points * errors * to_points.transpose());
    draft.ln_multiplier_covariance = floored_covariance(to_multipliers * errors * to_multipliers.transpose());
    draft.common.resize(n * p + n, image.cols());
    draft.common << to_points * image, to_multipliers * image;
    if (section.turns_known()) {
        std::vector<double> advance;
        for (Eigen::Index d = 0; d < n; ++d)
            if (section.is_angle(d)) advance.push_back(std::nearbyint(turns[d]));
        draft.advance = Eigen::Map<const Eigen::VectorXd>(advance.data(), static_cast<Eigen::Index>(advance.size()));
    }
    return draft;
}

}  // namespace orbid::orbits
