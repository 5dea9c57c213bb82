#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/errors/joint_covariance.hpp"
#include "estimator/minimisation/error_parameter.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

namespace {

/// [S_z S] P of every block, without the columns of undetermined latent states. Likewise for the rows that link it to
/// the next one.
struct Spread {
    std::vector<Eigen::MatrixXd> own;
    std::vector<Eigen::MatrixXd> linked;
};

Spread spread(const ErrorProblem& problem, const ErrorPoint& point) {
    const SelectedCovariance covariance = selected_covariance(point.standard.arrow, point.reduced_problem,
                                                              problem.restricted ? point.triangle : Eigen::MatrixXd());
    const auto through = [](const Eigen::Ref<const Eigen::MatrixXd>& at, const Eigen::MatrixXd& p) {
        Eigen::MatrixXd result;
        if (at.rows() > 0 && p.cols() > 0) result.noalias() = at.leftCols(p.cols()) * p;
        return result;
    };
    Spread result;
    result.own.resize(problem.rows.size());
    result.linked.resize(problem.rows.size());
    for (std::size_t b = 0; b < problem.rows.size(); ++b) {
        result.own[b] = through(point.standard.own_rows(b), covariance.block[b]);
        if (point.standard.linked_records[b] > 0)
            result.linked[b] = through(point.standard.linked_rows(b), covariance.link[b]);
    }
    return result;
}

/// (M10) for a full covariance: V = [sum_i (e_i e_i^T + J_i C J_i^T) + Psi] / (n + nu + m + 1), as a step of psi.
void joint_step(const ErrorProblem& problem, const ErrorPoint& point, const NoiseModel& law, std::size_t index,
                const Eigen::VectorXd& psi, const Spread& spread, Eigen::VectorXd& step) {
    const auto m = static_cast<Eigen::Index>(law.channels.size());
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(m, m);
    double records = 0.0;
    const auto add = [&](const std::vector<PartRows>& parts, const Eigen::Ref<const Eigen::MatrixXd>& standard,
                         const Eigen::MatrixXd& through) {
        Eigen::Index row = 0;
        for (const PartRows& part : parts) {
            const Eigen::Index rows = part.records.rows.rows() * rows_per_record((*problem.laws)[part.law]);
            if (part.law == index) {
                const Eigen::Index n = part.records.count / m;
                for (Eigen::Index i = 0; i < m; ++i)
                    for (Eigen::Index j = 0; j < m; ++j) {
                        sum(i, j) += standard.block(row + i * n, standard.cols() - 1, n, 1)
                                         .cwiseProduct(standard.block(row + j * n, standard.cols() - 1, n, 1))
                                         .sum();
                        if (through.size() > 0)
                            sum(i, j) += standard.block(row + i * n, 0, n, through.cols())
                                             .cwiseProduct(through.middleRows(row + j * n, n))
                                             .sum();
                    }
                records += static_cast<double>(n);
            }
            row += rows;
        }
    };
    for (std::size_t b = 0; b < problem.rows.size(); ++b) {
        add(problem.rows[b].parts, point.standard.own_rows(b), spread.own[b]);
        add(problem.rows[b].linked_parts, point.standard.linked_rows(b), spread.linked[b]);
    }
    const Eigen::MatrixXd lower = covariance_root(law, psi);
    Eigen::MatrixXd v = lower * sum * lower.transpose();
    double divisor = records;
    if (law.inverse_wishart_dof > 0.0) {
        v += law.inverse_wishart_psi;
        divisor += law.inverse_wishart_dof + static_cast<double>(m) + 1.0;
    }
    const models::CholeskyFactor factor(v / divisor);
    if (!factor.positive_definite()) return;
    const auto size = static_cast<Eigen::Index>(law.coordinates.size());
    step.segment(law.first, size) = root_coordinates(factor.lower()) - psi.segment(law.first, size);
}

/// Fixed-point steps of (M10): of each law by itself, and of all plain scales together.
std::vector<Eigen::VectorXd> far_steps(const ErrorProblem& problem, const ErrorPoint& point, const Eigen::VectorXd& psi,
                                       const std::vector<Eigen::Index>& free) {
    Eigen::VectorXd own = Eigen::VectorXd::Zero(psi.size());
    Eigen::VectorXd common = Eigen::VectorXd::Zero(psi.size());
    double fit = 0.0;
    double left = 0.0;
    for (const Eigen::Index k : free) {
        if (!(point.fit[k] > 0.0)) continue;
        // (M10) solved for the factor on s^2 with its trace t held: fit / (n - t), exact for one scale. Where a coupled
        // shape makes that meaningless: 1 - gradient / n, which is always positive for one scale.
        const double count = point.gradient[k] + point.fit[k];
        const double ratio =
            point.left[k] > 1e-3 ? point.fit[k] / point.left[k] : 1.0 - point.gradient[k] / std::max(count, 1.0);
        own[k] = 0.5 * std::log(std::max(ratio, 1e-12));
        common[k] = 1.0;
        fit += point.fit[k];
        left += point.left[k];
    }
    Spread through;
    for (std::size_t l = 0; l < problem.laws->size(); ++l) {
        const NoiseModel& law = (*problem.laws)[l];
        if (!law.joint() || !problem.free[static_cast<std::size_t>(law.first)]) continue;
        if (through.own.empty()) through = spread(problem, point);
        joint_step(problem, point, law, l, psi, through, own);
    }
    std::vector<Eigen::VectorXd> steps;
    if (own.lpNorm<Eigen::Infinity>() > 0.0) steps.push_back(own);
    // The same for all scales together: exact where a shape ties them to each other.
    if (fit > 0.0 && left > 1e-3 && common.sum() > 1.5) steps.push_back(common * (0.5 * std::log(fit / left)));
    return steps;
}

/// Secant (BFGS) update of a Hessian: H s = y afterwards; skipped where y^T s > 0 does not hold.
void update(Eigen::MatrixXd& hessian, const Eigen::VectorXd& s, const Eigen::VectorXd& y) {
    const Eigen::VectorXd h_s = hessian * s;
    const double curvature = y.dot(s);
    const double expected = s.dot(h_s);
    if (!(curvature > 1e-8 * expected)) return;
    hessian += y * y.transpose() / curvature - h_s * h_s.transpose() / expected;
}

/// A positive definite stand-in: eigenvalues by their absolute value, at least a millionth of the largest.
Eigen::MatrixXd made_definite(const Eigen::MatrixXd& hessian) {
    const models::SymmetricEigen eigen = models::symmetric_eigen(hessian);
    const Eigen::VectorXd size = eigen.values.cwiseAbs();
    const double least = std::max(1e-6 * size.maxCoeff(), 1e-300);
    return eigen.vectors * size.cwiseMax(least).asDiagonal() * eigen.vectors.transpose();
}

/// Curvature to start with: 2 fit for plain scales (exact curvature of ln s at its minimum is 2 n), differences else.
Eigen::MatrixXd first_hessian(const ErrorProblem& problem, const ErrorPoint& point, const Eigen::VectorXd& psi,
                              const std::vector<Eigen::Index>& free) {
    const auto count = static_cast<Eigen::Index>(free.size());
    Eigen::VectorXd diagonal(count);
    bool plain = true;
    for (Eigen::Index i = 0; i < count; ++i) {
        diagonal[i] = 2.0 * point.fit[free[static_cast<std::size_t>(i)]];
        plain = plain && diagonal[i] > 0.0;
    }
    // Latent states distribute the residuals between scales: their curvature is far from that of separate ones.
    if (plain && problem.set->latents == 0) return diagonal.asDiagonal();
    return made_definite(error_hessian(problem, psi, free));
}

Eigen::VectorXd picked(const Eigen::VectorXd& from, const std::vector<Eigen::Index>& free) {
    Eigen::VectorXd result(static_cast<Eigen::Index>(free.size()));
    for (std::size_t i = 0; i < free.size(); ++i)
        result[static_cast<Eigen::Index>(i)] = from[free[i]];
    return result;
}

}  // namespace

ErrorMinimum minimise_errors(const ErrorProblem& problem, const Eigen::VectorXd& start, const Eigen::VectorXd& floor,
                             const Eigen::VectorXd& ceiling, const ErrorSearch& search) {
    ErrorMinimum minimum;
    minimum.psi = start;
    for (Eigen::Index k = 0; k < start.size(); ++k)
        if (problem.free[static_cast<std::size_t>(k)]) minimum.psi[k] = std::clamp(start[k], floor[k], ceiling[k]);
    minimum.at_floor.assign(static_cast<std::size_t>(start.size()), false);
    minimum.at_ceiling = minimum.at_floor;
    ErrorPoint point = evaluate_errors(problem, minimum.psi);
    minimum.before = minimum.after = point.value;
    ErrorCurvature unknown;
    ErrorCurvature& curvature = search.known != nullptr ? *search.known : unknown;
    std::vector<Eigen::Index>& former_free = curvature.free;
    Eigen::MatrixXd& hessian = curvature.hessian;
    // Six decades take a few fixed-point steps, secant steps then converge superlinearly; two dozen are usual at most.
    constexpr int step_limit = 200;
    for (int iteration = 0; iteration < step_limit; ++iteration) {
        std::vector<Eigen::Index> free;
        for (Eigen::Index k = 0; k < start.size(); ++k) {
            const auto index = static_cast<std::size_t>(k);
            minimum.at_floor[index] = problem.free[index] && minimum.psi[k] <= floor[k] && point.gradient[k] > 0.0;
            minimum.at_ceiling[index] = problem.free[index] && minimum.psi[k] >= ceiling[k] && point.gradient[k] < 0.0;
            if (problem.free[index] && !minimum.at_floor[index] && !minimum.at_ceiling[index]) free.push_back(k);
        }
        minimum.distance = 0.0;
        if (free.empty()) return minimum;
        const auto count = static_cast<Eigen::Index>(free.size());
        const Eigen::VectorXd gradient = picked(point.gradient, free);
        if (free != former_free) hessian = first_hessian(problem, point, minimum.psi, free);
        former_free = free;
        for (Eigen::Index i = 0; i < count; ++i)
            minimum.distance =
                std::max(minimum.distance, std::abs(gradient[i]) / std::sqrt(std::max(hessian(i, i), 1e-300)));
        if (minimum.distance < search.tolerance) return minimum;

        const models::LdltFactor factor(hessian);
        const auto pivots = factor.pivots();
        const bool definite =
            factor.succeeded() && factor.positive_semidefinite() && pivots.minCoeff() > 1e-10 * pivots.maxCoeff();
        std::vector<Eigen::VectorXd> steps;
        if (definite) {
            const Eigen::VectorXd newton = -factor.solve(gradient);
            if (newton.lpNorm<Eigen::Infinity>() < search.untried) {
                for (Eigen::Index i = 0; i < count; ++i) {
                    const Eigen::Index k = free[static_cast<std::size_t>(i)];
                    minimum.psi[k] = std::clamp(minimum.psi[k] + newton[i], floor[k], ceiling[k]);
                }
                minimum.after += 0.5 * gradient.dot(newton);
                ++minimum.steps;
                return minimum;
            }
            Eigen::VectorXd step = Eigen::VectorXd::Zero(start.size());
            for (Eigen::Index i = 0; i < count; ++i)
                step[free[static_cast<std::size_t>(i)]] = newton[i];
            steps.push_back(std::move(step));
        }
        // Curvature does not predict a minimum that is many sds and a large part of the scale itself away.
        constexpr double near = 0.1;
        if (!definite ||
            (minimum.distance > 1.0 && (search.known == nullptr || steps.back().lpNorm<Eigen::Infinity>() > near)))
            for (Eigen::VectorXd& step : far_steps(problem, point, minimum.psi, free))
                steps.push_back(std::move(step));

        const auto trial_of = [&](const Eigen::VectorXd& step) {
            Eigen::VectorXd trial = minimum.psi;
            for (const Eigen::Index k : free)
                trial[k] = std::clamp(trial[k] + std::clamp(step[k], -5.0, 5.0), floor[k], ceiling[k]);
            return trial;
        };
        // Near the minimum rounding hides the difference of two values. The trapezoidal rule of the gradient keeps it
        // (relative error ~ |step|).
        const auto change_to = [&](const Eigen::VectorXd& trial, const ErrorPoint& next) {
            const Eigen::VectorXd moved = trial - minimum.psi;
            return moved.lpNorm<Eigen::Infinity>() < 1e-3 ? 0.5 * (point.gradient + next.gradient).dot(moved)
                                                          : next.value - point.value;
        };
        Eigen::VectorXd best;
        ErrorPoint best_point;
        double best_change = 0.0;
        for (int shortening = 0; shortening < 30 && !(best_change < 0.0); ++shortening) {
            for (Eigen::VectorXd& step : steps) {
                Eigen::VectorXd trial = trial_of(step);
                step *= 0.3;
                if (!((trial - minimum.psi).lpNorm<Eigen::Infinity>() > 0.0)) continue;
                ErrorPoint next = evaluate_errors(problem, trial);
                const double change = change_to(trial, next);
                if (!(change < best_change)) continue;
                best_change = change;
                best = std::move(trial);
                best_point = std::move(next);
            }
        }
        if (!(best_change < 0.0)) return minimum;
        // A long step past the minimum along its direction may end where a scale no longer matters and the objective is
        // flat. Halve it while that gains.
        constexpr int halvings = 8;
        for (int halving = 0; halving < halvings; ++halving) {
            const Eigen::VectorXd moved = best - minimum.psi;
            if (moved.lpNorm<Eigen::Infinity>() < 0.5 || !(best_point.gradient.dot(moved) > 0.0)) break;
            Eigen::VectorXd half = minimum.psi + 0.5 * moved;
            ErrorPoint next = evaluate_errors(problem, half);
            const double change = change_to(half, next);
            if (!(change < best_change)) break;
            best_change = change;
            best = std::move(half);
            best_point = std::move(next);
        }
        const Eigen::VectorXd s = picked(best - minimum.psi, free);
        const Eigen::VectorXd y = picked(best_point.gradient - point.gradient, free);
        minimum.psi = std::move(best);
        minimum.after += best_change;
        point = std::move(best_point);
        ++minimum.steps;
        // A long step gives no information about the curvature where it ends.
        if (s.lpNorm<Eigen::Infinity>() > 0.5)
            hessian = first_hessian(problem, point, minimum.psi, free);
        else
            update(hessian, s, y);
    }
    return minimum;
}

Eigen::VectorXd integrated_scales(const ErrorProblem& problem, const ErrorMinimum& minimum) {
    // Gauss-Hermite nodes by the eigenvalues of the Jacobi matrix (Golub and Welsch 1969).
    constexpr Eigen::Index nodes = 15;
    Eigen::MatrixXd jacobi = Eigen::MatrixXd::Zero(nodes, nodes);
    for (Eigen::Index i = 1; i < nodes; ++i)
        jacobi(i, i - 1) = jacobi(i - 1, i) = std::sqrt(0.5 * static_cast<double>(i));
    const models::SymmetricEigen rule = models::symmetric_eigen(jacobi);
    Eigen::VectorXd psi = minimum.psi;
    for (const NoiseModel& law : *problem.laws) {
        const Eigen::Index k = law.first;
        const auto index = static_cast<std::size_t>(k);
        if (!problem.free[index] || !law.compressible() || minimum.at_floor[index] || minimum.at_ceiling[index])
            continue;
        if (std::holds_alternative<FlatPrior>(law.coordinates.front().prior)) continue;
        const double curvature = error_hessian(problem, minimum.psi, {k})(0, 0);
        if (!(curvature > 0.0)) continue;
        const double width = std::sqrt(2.0 / curvature);
        const double at_minimum = evaluate_errors(problem, minimum.psi).value;
        double total = 0.0;
        double weight = 0.0;
        for (Eigen::Index i = 0; i < nodes; ++i) {
            const double t = rule.values[i];
            Eigen::VectorXd shifted = minimum.psi;
            shifted[k] += width * t;
            const double density = std::pow(rule.vectors(0, i), 2) *
                                   std::exp(t * t - (evaluate_errors(problem, shifted).value - at_minimum));
            total += density;
            weight += density * std::exp(-2.0 * width * t);
        }
        psi[k] -= 0.5 * std::log(weight / total);
    }
    return psi;
}

}  // namespace orbid::estimator
