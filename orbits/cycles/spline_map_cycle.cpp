#include "orbits/cycles/spline_map_cycle.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/arithmetic/lu_factor.hpp"
#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/local_maps/floored_covariance.hpp"

namespace orbid::orbits {

namespace {

// Largest coordinate of a Newton step: a patch is about as wide.
constexpr double spline_step_cap = 0.04;

// Newton has converged when its step is down to rounding. From far starts it walks: 0.2 away is five capped steps.
constexpr double converged_spline_step = 1e-12;
constexpr int most_spline_steps = 40;

// Relative change of a jacobian's entries for the derivative of ln|multipliers|: errors of 1e-6 of it.
constexpr double jacobian_difference_step = 1e-6;

// d ln|multipliers| / d (entries of A_0, A_1, ..., column by column), shape (n, p n n).
Eigen::MatrixXd multiplier_derivative(std::vector<Eigen::MatrixXd> jacobians) {
    const Eigen::Index n = jacobians.front().rows();
    Eigen::MatrixXd result(n, static_cast<Eigen::Index>(jacobians.size()) * n * n);
    Eigen::Index column = 0;
    for (std::size_t j = 0; j < jacobians.size(); ++j) {
        const double step = jacobian_difference_step * std::max(jacobians[j].norm(), jacobian_difference_step);
        for (Eigen::Index entry = 0; entry < n * n; ++entry) {
            const double kept = jacobians[j].data()[entry];
            jacobians[j].data()[entry] = kept + step;
            const Eigen::VectorXd above = cycle_multipliers(jacobians).ln_modulus;
            jacobians[j].data()[entry] = kept - step;
            const Eigen::VectorXd below = cycle_multipliers(jacobians).ln_modulus;
            jacobians[j].data()[entry] = kept;
            const Eigen::VectorXd slope = (above - below) / (2.0 * step);
            result.col(column++) = slope.array().isFinite().select(slope, 0.0);
        }
    }
    return result;
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

CycleCandidate draft_of(const SectionPoints& section, const SplineMapFit& fit, const SplineMapCycle& cycle) {
    const Eigen::Index n = cycle.points.rows(), p = cycle.points.cols();
    const auto size = static_cast<std::size_t>(fit.map.basis().unknowns());
    const Eigen::Index entries = n * (n + 1);  // of a point: value, then the columns of the jacobian
    std::vector<Eigen::MatrixXd> jacobians;
    std::vector<MapValue> values(static_cast<std::size_t>(p));
    Eigen::VectorXd turns = Eigen::VectorXd::Zero(n);
    // rows: root (value and jacobian entries of all points)', one column per entry
    Eigen::MatrixXd image = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(size), entries * p);
    for (Eigen::Index j = 0; j < p; ++j) {
        MapValue& value = values[static_cast<std::size_t>(j)];
        fit.map.evaluate(cycle.points.col(j).data(), 2, value);
        jacobians.push_back(value.jacobian);
        turns += value.displacement;
        for (std::size_t f = 0; f < value.support.patch.size(); ++f)
            for (Eigen::Index d = 0; d < n; ++d) {
                const auto unknown = static_cast<std::size_t>(value.support.patch[f] * n + d);
                if (fit.map.basis().fixed()[unknown]) continue;
                const auto column = static_cast<Eigen::Index>(f);
                const double sign = fit.map.sign(value.support.mirrored[f] != 0, d);
                for (std::size_t i = unknown; i < size; ++i) {
                    const double root = sign * fit.root[i * size + unknown];
                    const auto row = static_cast<Eigen::Index>(i);
                    image(row, j * entries + d) += root * value.support.value[column];
                    for (Eigen::Index a = 0; a < n; ++a)
                        image(row, j * entries + n + a * n + d) += root * value.support.slope(a, column);
                }
            }
    }
    Eigen::MatrixXd errors = image.transpose() * image;
    for (Eigen::Index j = 0; j < p; ++j) {
        const Eigen::VectorXd& missed = fit.model_error.variance(fit.map.basis(), cycle.points.col(j).data());
        for (Eigen::Index d = 0; d < n; ++d) {
            errors(j * entries + d, j * entries + d) += missed[d];
            for (Eigen::Index a = 0; a < n; ++a) {
                const Eigen::Index entry = j * entries + n + a * n + d;
                errors(entry, entry) += missed[d] / std::pow(fit.map.basis().spacing(a), 2);
            }
        }
    }

    CycleCandidate draft;
    draft.points = cycle.points;
    draft.multipliers = cycle_multipliers(jacobians);
    const Eigen::MatrixXd inverse = -models::inverse(coupled_matrix(jacobians));
    const Eigen::MatrixXd derivative = multiplier_derivative(jacobians);
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
    if (section.turns_known()) {
        std::vector<double> advance;
        for (Eigen::Index d = 0; d < n; ++d)
            if (section.angle()[static_cast<std::size_t>(d)]) advance.push_back(std::nearbyint(turns[d]));
        draft.advance = Eigen::Map<const Eigen::VectorXd>(advance.data(), static_cast<Eigen::Index>(advance.size()));
    }
    return draft;
}

}  // namespace orbid::orbits
