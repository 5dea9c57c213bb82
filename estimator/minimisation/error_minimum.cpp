#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "estimator/minimisation/average_information.hpp"
#include "estimator/minimisation/error_parameter.hpp"
#include "estimator/minimisation/far_step.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

namespace {

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

/// A place to go to.
struct ErrorTrial {
    Eigen::VectorXd psi;
    ErrorPoint point;
    double change = 0.0;  ///< of Phi_psi; < 0: an improvement
};

/// The search of minimise_errors().
class ErrorDescent {
public:
    ErrorDescent(const ErrorProblem& problem, const Eigen::VectorXd& start, const Eigen::VectorXd& floor,
                 const Eigen::VectorXd& ceiling, const ErrorSearch& search, std::optional<WhitenedArrow> standard)
        : problem_(problem),
          floor_(floor),
          ceiling_(ceiling),
          search_(search),
          curvature_(search.known != nullptr ? *search.known : unknown_),
          droppable_(is_long(*problem.set) && std::none_of(problem.laws->begin(), problem.laws->end(),
                                                           [](const NoiseModel& law) { return law.joint(); })) {
        minimum_.psi = start;
        for (Eigen::Index k = 0; k < start.size(); ++k)
            if (problem.free[static_cast<std::size_t>(k)]) minimum_.psi[k] = within_limits(k, start[k]);
        minimum_.at_floor.assign(static_cast<std::size_t>(start.size()), false);
        minimum_.at_ceiling = minimum_.at_floor;
        point_ = standard && minimum_.psi == start ? evaluate_errors(problem, start, *std::move(standard))
                                                   : evaluate_errors(problem, minimum_.psi);
        minimum_.before = minimum_.after = point_.value;
    }

    ErrorMinimum run();

private:
    [[nodiscard]] double within_limits(Eigen::Index k, double psi) const {
        return std::clamp(psi, floor_[k], ceiling_[k]);
    }
    void release();
    void measure();
    void take_curvature();
    [[nodiscard]] Eigen::VectorXd newton_step() const;
    void take_untried(const Eigen::VectorXd& newton);
    [[nodiscard]] std::vector<Eigen::VectorXd> candidates(const Eigen::VectorXd& newton) const;
    void try_place(Eigen::VectorXd psi, ErrorTrial& best) const;
    [[nodiscard]] ErrorTrial best_of(std::vector<Eigen::VectorXd> steps) const;
    void halve(ErrorTrial& best) const;
    void move_to(ErrorTrial best);

    const ErrorProblem& problem_;
    const Eigen::VectorXd& floor_;
    const Eigen::VectorXd& ceiling_;
    const ErrorSearch& search_;
    ErrorMinimum minimum_;
    ErrorPoint point_;                ///< at minimum_.psi, unless the last step was taken without a trial
    std::vector<Eigen::Index> free_;  ///< not held at a limit
    ErrorCurvature unknown_;
    ErrorCurvature& curvature_;
    /// Long data: what a point has factorised is given up before another one is evaluated. A search that ends there all
    /// the same leaves none.
    bool droppable_;
};

/// Frees all parameters but those that the gradient pushes against their limit.
void ErrorDescent::release() {
    free_.clear();
    for (Eigen::Index k = 0; k < minimum_.psi.size(); ++k) {
        const auto index = static_cast<std::size_t>(k);
        const bool free = problem_.free[index];
        minimum_.at_floor[index] = free && minimum_.psi[k] <= floor_[k] && point_.gradient[k] > 0.0;
        minimum_.at_ceiling[index] = free && minimum_.psi[k] >= ceiling_[k] && point_.gradient[k] < 0.0;
        if (free && !minimum_.at_floor[index] && !minimum_.at_ceiling[index]) free_.push_back(k);
    }
}

/// Curvature to start with: 2 fit for plain scales (exact curvature of ln s at its minimum is 2 n). Latent states
/// distribute the residuals between scales: their curvature is far from that of separate ones.
void ErrorDescent::take_curvature() {
    const Eigen::VectorXd fit = point_.fit(free_);
    if (problem_.set->latents == 0 && (fit.array() > 0.0).all()) {
        curvature_.hessian = (2.0 * fit).asDiagonal();
        return;
    }
    if (has_average_information(problem_, minimum_.psi, free_)) {
        // Twice at a point, where a parameter came free.
        if (point_.standard.arrow.blocks.empty()) point_ = evaluate_errors(problem_, minimum_.psi);
        if (droppable_) point_.reduced_problem.drop_blocks();
        WhitenedArrow rows = droppable_ ? std::exchange(point_.standard, {}) : point_.standard;
        curvature_.hessian = average_information(problem_, minimum_.psi, std::move(rows), point_.step, free_);
        return;
    }
    if (droppable_) point_.drop_factors();
    curvature_.hessian = made_definite(error_hessian(problem_, point_, minimum_.psi, free_));
}

/// Curvature over the parameters that may move, and the distance to their minimum.
void ErrorDescent::measure() {
    minimum_.distance = 0.0;
    if (free_.empty()) return;
    if (free_ != curvature_.free) take_curvature();
    curvature_.free = free_;
    const Eigen::VectorXd gradient = point_.gradient(free_);
    for (Eigen::Index i = 0; i < gradient.size(); ++i)
        minimum_.distance =
            std::max(minimum_.distance, std::abs(gradient[i]) / std::sqrt(std::max(curvature_.hessian(i, i), 1e-300)));
}

/// Newton's step of the free parameters; empty where the curvature has no minimum.
Eigen::VectorXd ErrorDescent::newton_step() const {
    const models::LdltFactor factor(curvature_.hessian);
    const auto pivots = factor.pivots();
    const bool definite =
        factor.succeeded() && factor.positive_semidefinite() && pivots.minCoeff() > 1e-10 * pivots.maxCoeff();
    if (!definite) return {};
    const Eigen::VectorXd gradient = point_.gradient(free_);
    return -factor.solve(gradient);
}

void ErrorDescent::take_untried(const Eigen::VectorXd& newton) {
    const Eigen::VectorXd gradient = point_.gradient(free_);
    minimum_.evaluated = minimum_.psi;
    for (Eigen::Index i = 0; i < newton.size(); ++i) {
        const Eigen::Index k = free_[static_cast<std::size_t>(i)];
        minimum_.psi[k] = within_limits(k, minimum_.psi[k] + newton[i]);
    }
    minimum_.after += 0.5 * gradient.dot(newton);
    ++minimum_.steps;
}

/// Newton's step, and fixed-point ones where it does not reach.
std::vector<Eigen::VectorXd> ErrorDescent::candidates(const Eigen::VectorXd& newton) const {
    // Curvature does not predict a minimum that is many sds and a large part of the scale itself away.
    constexpr double near = 0.1;
    std::vector<Eigen::VectorXd> result;
    if (newton.size() > 0) {
        result.emplace_back(Eigen::VectorXd::Zero(minimum_.psi.size()));
        result.back()(free_) = newton;
        if (!(minimum_.distance > 1.0) || (search_.known != nullptr && !(newton.lpNorm<Eigen::Infinity>() > near)))
            return result;
    }
    for (Eigen::VectorXd& step : far_steps(problem_, point_, minimum_.psi, free_))
        result.push_back(std::move(step));
    return result;
}

/// Makes a place the best one if it is better.
void ErrorDescent::try_place(Eigen::VectorXd psi, ErrorTrial& best) const {
    ErrorPoint next = evaluate_errors(problem_, psi);
    const Eigen::VectorXd moved = psi - minimum_.psi;
    // Near the minimum rounding hides the difference of two values. The trapezoidal rule of the gradient keeps it
    // (relative error ~ |step|).
    const double change = moved.lpNorm<Eigen::Infinity>() < 1e-3 ? 0.5 * (point_.gradient + next.gradient).dot(moved)
                                                                 : next.value - point_.value;
    if (change < best.change) best = {std::move(psi), std::move(next), change};
}

/// The best of the steps, shortened together until one of them is an improvement.
ErrorTrial ErrorDescent::best_of(std::vector<Eigen::VectorXd> steps) const {
    ErrorTrial best;
    for (int shortening = 0; shortening < 30 && !(best.change < 0.0); ++shortening)
        for (Eigen::VectorXd& step : steps) {
            Eigen::VectorXd psi = minimum_.psi;
            for (const Eigen::Index k : free_)
                psi[k] = within_limits(k, psi[k] + std::clamp(step[k], -5.0, 5.0));
            step *= 0.3;
            if ((psi - minimum_.psi).lpNorm<Eigen::Infinity>() > 0.0) try_place(std::move(psi), best);
        }
    return best;
}

/// A long step past the minimum along its direction may end where a scale no longer matters and the objective is flat.
/// Halves it while that gains.
void ErrorDescent::halve(ErrorTrial& best) const {
    constexpr int halvings = 8;
    for (int halving = 0; halving < halvings; ++halving) {
        const Eigen::VectorXd moved = best.psi - minimum_.psi;
        if (moved.lpNorm<Eigen::Infinity>() < 0.5 || !(best.point.gradient.dot(moved) > 0.0)) return;
        const double before = best.change;
        try_place(minimum_.psi + 0.5 * moved, best);
        if (!(best.change < before)) return;
    }
}

void ErrorDescent::move_to(ErrorTrial best) {
    const Eigen::VectorXd s = best.psi(free_) - minimum_.psi(free_);
    const Eigen::VectorXd y = best.point.gradient(free_) - point_.gradient(free_);
    minimum_.psi = std::move(best.psi);
    minimum_.after += best.change;
    point_ = std::move(best.point);
    ++minimum_.steps;
    // A long step gives no information about the curvature where it ends.
    if (s.lpNorm<Eigen::Infinity>() > 0.5)
        take_curvature();
    else
        update(curvature_.hessian, s, y);
}

ErrorMinimum ErrorDescent::run() {
    // Six decades take a few fixed-point steps, secant steps then converge superlinearly; two dozen are usual at most.
    constexpr int step_limit = 200;
    // So close, in sds and in ln s, a step that does not come ten times closer has met the rounding of the gradient.
    constexpr double close = 1e-7;
    double before = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < step_limit; ++iteration) {
        release();
        measure();
        if (free_.empty() || minimum_.distance < search_.tolerance) break;
        const Eigen::VectorXd newton = newton_step();
        const bool near = before < close && newton.size() > 0 && newton.lpNorm<Eigen::Infinity>() < close;
        if (near && !(minimum_.distance < 0.1 * before)) break;
        before = minimum_.distance;
        if (newton.size() > 0 && newton.lpNorm<Eigen::Infinity>() < search_.untried) {
            take_untried(newton);
            break;
        }
        std::vector<Eigen::VectorXd> steps = candidates(newton);
        if (droppable_) point_.drop_factors();
        ErrorTrial best = best_of(std::move(steps));
        if (!(best.change < 0.0)) break;
        halve(best);
        move_to(std::move(best));
    }
    if (minimum_.evaluated.size() == 0) minimum_.evaluated = minimum_.psi;
    if (!point_.standard.arrow.blocks.empty()) minimum_.standard = std::move(point_.standard);
    return std::move(minimum_);
}

}  // namespace

ErrorMinimum minimise_errors(const ErrorProblem& problem, const Eigen::VectorXd& start, const Eigen::VectorXd& floor,
                             const Eigen::VectorXd& ceiling, const ErrorSearch& search,
                             std::optional<WhitenedArrow> standard) {
    return ErrorDescent(problem, start, floor, ceiling, search, std::move(standard)).run();
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
        const ErrorPoint point = evaluate_errors(problem, minimum.psi);
        const double curvature = error_hessian(problem, point, minimum.psi, {k})(0, 0);
        if (!(curvature > 0.0)) continue;
        const double width = std::sqrt(2.0 / curvature);
        const double at_minimum = point.value;
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
