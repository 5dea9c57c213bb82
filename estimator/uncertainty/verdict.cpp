#include "estimator/uncertainty/verdict.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "estimator/algebra/r_factor.hpp"
#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// Where the objective is looked at, in posterior sds: a 95 % interval ends there.
constexpr double reach = 2.0;
/// Probability outside of `reach` sds to both sides, 4.55 % when all is normal, with the signed root of twice the rise
/// as the normal variable. Intervals from the normal approximation that claim 95 % then hold 92.5 to 99 %. Measured:
/// 4.5 to 4.7 % for Bock's problem and hare and lynx. At most 5.6 % for NIST's Thurber (its profile is lopsided, roots
/// of 1.6 and 2.9). 10 % for the heavy tail of a Michaelis-Menten constant even on a log scale.
constexpr double least_outside = 0.01;
constexpr double most_outside = 0.075;
/// With the others moved linearly the objective is too high (by 0.15 for that tail): accurate enough this close to 1.
constexpr double linear_margin = 0.1;
/// A minimisation with one parameter held ends with this much of a full step left, in sds: a few Gauss-Newton steps
/// suffice, for what is left changes the rise to second order only.
constexpr double held_step_left = 0.05;
/// The same of long data, where each step counts. What is left is taken from the rise as the quadratic model has it: at
/// most 0.01 of the root, a tenth of the margin above.
constexpr double long_step_left = 0.3;
/// Of long data, whose second side begins on the bent course of the first: beyond this many times the expected root a
/// straight one may be better.
constexpr double most_bent = 1.5;
/// Of the points from which the full Hessian is told, in sds of the Gauss-Newton objective.
constexpr double aside = 0.1;
/// sd from the full Hessian over the Gauss-Newton one that is still called the same.
constexpr double most_ratio = 2.0;

/// The state moved by d in u, latent states following linearly.
State moved(const Problem& problem, const BlockSet& set, State from, const LatentCourse& course,
            const Eigen::VectorXd& d) {
    from.u = (from.u + d).cwiseMax(problem.lower).cwiseMin(problem.upper);
    from.theta = natural_parameters(problem, from.u);
    course.follow(d, set, from.latents);
    return from;
}

/// Twice the rise of Phi from the minimum to `errors` at u; nan when it cannot be computed.
double deviance(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
                const Eigen::VectorXd& u, const BlockErrors& errors) {
    const double prior = prior_at(problem, u).value - minimum.prior.value;
    return 2.0 * (prior + value_change(set, problem.laws, state.psi, minimum.errors, errors));
}

/// The problem with one parameter held and the error parameters as they are.
Problem held(const Problem& problem, Eigen::Index parameter, double u, double step_left) {
    Problem result = problem;
    result.lower[parameter] = result.upper[parameter] = u;
    for (NoiseModel& law : result.laws)
        for (ErrorCoordinate& coordinate : law.coordinates)
            coordinate.estimate = false;
    result.options.maximum_iterations = 10;
    result.options.step_tolerance = step_left;
    result.polished = false;
    result.options.progress = nullptr;
    result.options.watched = nullptr;
    return result;
}

/// Probability of a standard normal variable above x.
double beyond(double x) {
    return 0.5 * std::erfc(x / std::numbers::sqrt2);
}

/// Directions in which the Gauss-Newton objective is that of independent standard normal variables: the inverse of the
/// R factor of its rows, data and priors, shape (free, free). From the rows themselves, since their squares would lose
/// what distinguishes directions of very different weight. Empty where a direction has no weight.
Eigen::MatrixXd standard_directions(const Eigen::MatrixXd& data, const Eigen::MatrixXd& prior) {
    const Eigen::Index count = data.cols();
    Eigen::MatrixXd rows(data.rows() + prior.rows(), count);
    rows << data, prior;
    const Eigen::MatrixXd r = upper_triangle(rows);
    if ((r.diagonal().array() == 0.0).any()) return {};
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(count, count);
    models::solve_upper_in_place(r, inverse);
    return inverse;
}

/// The largest part of `step` from u that stays within the bounds, 0 to 1.
double part_within(const Problem& problem, const Eigen::VectorXd& u, const Eigen::VectorXd& step) {
    double part = 1.0;
    for (Eigen::Index i = 0; i < step.size(); ++i) {
        if (step[i] == 0.0) continue;
        const double room = step[i] > 0.0 ? problem.upper[i] - u[i] : problem.lower[i] - u[i];
        part = std::min(part, std::max(room / step[i], 0.0));
    }
    return part;
}

/// Whether the full Hessian is definite, and by how much its determinant and sds differ from Gauss and Newton's.
/// @param standard  it in `directions`, where Gauss and Newton's is the unit matrix.
void compare_curvatures(const Eigen::MatrixXd& standard, const Eigen::MatrixXd& directions,
                        const std::vector<Eigen::Index>& free, FullHessian& result) {
    result.known = true;
    const models::LdltFactor factor(standard);
    const auto pivots = factor.pivots();
    result.definite = factor.succeeded() && (pivots.array() > 0.0).all();
    if (!result.definite) return;
    result.ln_determinant = pivots.array().log().sum();
    const Eigen::MatrixXd inverse = directions * factor.solve(Eigen::MatrixXd(directions.transpose()));
    for (Eigen::Index i = 0; i < inverse.cols(); ++i)
        result.ratio[free[static_cast<std::size_t>(i)]] = std::sqrt(inverse(i, i) / directions.row(i).squaredNorm());
}

}  // namespace

FullHessian full_hessian(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
                         const Posterior& posterior, const LatentCourse& course, int& evaluations) {
    const Eigen::Index q = state.u.size();
    FullHessian result;
    result.ratio = Eigen::VectorXd::Constant(q, nan_value);
    const auto& free = minimum.step.free;
    const auto count = static_cast<Eigen::Index>(free.size());
    if (set.constraints > 0 || count == 0) return result;
    for (const Eigen::Index i : free)
        if (posterior.identifiable().undetermined[static_cast<std::size_t>(i)]) return result;

    std::vector<std::vector<Eigen::VectorXd>> following;
    for (const Eigen::Index i : free)
        following.push_back(course.along(i));
    std::vector<Eigen::VectorXd> units;
    for (const Eigen::Index i : free)
        units.emplace_back(Eigen::VectorXd::Unit(q, i));
    std::vector<Direction> directions;
    for (std::size_t i = 0; i < units.size(); ++i)
        directions.push_back({units[i], following[i]});
    const Eigen::MatrixXd standard =
        standard_directions(posterior.reduced_problem().r(Eigen::all, free), minimum.prior.rows(Eigen::all, free));
    if (standard.size() == 0) return result;
    Eigen::MatrixXd hessian(count, count);
    for (Eigen::Index j = 0; j < count; ++j) {
        double length = 0.0;
        Eigen::VectorXd difference = Eigen::VectorXd::Zero(count);
        for (const double sign : {-1.0, 1.0}) {
            Eigen::VectorXd step = Eigen::VectorXd::Zero(q);
            step(free) = sign * aside * standard.col(j);
            const double part = part_within(problem, state.u, step);
            length += aside * part;
            const State beside = moved(problem, set, state, course, part * step);
            const Evaluation evaluation =
                evaluate(problem.residuals, set, problem.laws, beside.theta, beside.latents, true);
            ++evaluations;
            if (!evaluation.failed.empty()) return result;
            difference += sign * slopes_along(set, evaluation.values, problem.coordinates, beside.theta, problem.laws,
                                              {state.psi, minimum.matching, Curvature::step}, directions);
        }
        if (!(length > 0.0)) return result;
        hessian.col(j) = standard.transpose() * difference / length;
    }
    hessian = 0.5 * (hessian + hessian.transpose()).eval();
    hessian += standard.transpose() * minimum.prior.second(free, free) * standard;
    compare_curvatures(hessian, standard, free, result);
    return result;
}

namespace {

/// The objective where one parameter is some sds away and the others are at their best.
class Sides {
public:
    Sides(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
          const LatentCourse& course, int& evaluations)
        : problem_(problem),
          set_(set),
          state_(state),
          minimum_(minimum),
          course_(course),
          evaluations_(evaluations),
          long_(is_long(set) && set.constraints == 0) {}

    struct Side {
        double rise = nan_value;  ///< twice that of Phi
        bool minimised = false;   ///< the others did not only follow
        Outcome outcome = Outcome::converged;
    };
    /// @param step  the parameters' step along the linear course. Of two opposite ones the second gains by the first.
    [[nodiscard]] Side look(Eigen::Index parameter, const Eigen::VectorXd& step);

private:
    [[nodiscard]] double rise_at(const State& at);
    [[nodiscard]] static bool is_linear(double rise) {
        return std::abs(std::sqrt(rise) / reach - 1.0) <= linear_margin;
    }

    const Problem& problem_;
    const BlockSet& set_;
    const State& state_;
    const Minimum& minimum_;
    const LatentCourse& course_;
    int& evaluations_;
    bool long_;                      ///< each evaluation takes long
    Eigen::Index parameter_ = -1;    ///< the last one
    std::optional<State> opposite_;  ///< its minimum on the other side, where the course was bent
};

/// nan where it cannot be told from values alone.
double Sides::rise_at(const State& at) {
    if (set_.constraints > 0) return nan_value;
    const Evaluation evaluation = evaluate(problem_.residuals, set_, problem_.laws, at.theta, at.latents, false);
    ++evaluations_;
    if (!evaluation.failed.empty()) return nan_value;
    return deviance(problem_, set_, state_, minimum_, at.u, BlockErrors(evaluation.values));
}

Sides::Side Sides::look(Eigen::Index parameter, const Eigen::VectorXd& step) {
    State trial;
    Side side;
    const double u = state_.u[parameter] + step[parameter];
    if (std::exchange(parameter_, parameter) != parameter) opposite_.reset();
    if (opposite_) {
        // A bend is the same on both sides: what is left are terms of the third order.
        trial = moved(problem_, set_, *std::exchange(opposite_, std::nullopt), course_, 2.0 * step);
        side.rise = rise_at(trial);
        if (is_linear(side.rise)) return side;
    }
    if (!(std::sqrt(side.rise) < most_bent * reach)) {
        State straight = moved(problem_, set_, state_, course_, step);
        const double rise = rise_at(straight);
        if (is_linear(rise)) return {rise, false, Outcome::converged};
        if (!(side.rise < rise)) trial = std::move(straight);
    }
    const Problem pinned = held(problem_, parameter, u, long_ ? long_step_left : held_step_left);
    trial.u[parameter] = u;
    trial.theta[parameter] = problem_.coordinates[static_cast<std::size_t>(parameter)].natural(u);
    SolverStatistics ledger;
    const Minimum beside = minimise(pinned, set_, trial, ledger);
    evaluations_ += ledger.evaluations;
    side = {nan_value, true, beside.outcome};
    if (beside.outcome == Outcome::start_failed || beside.outcome == Outcome::blocks_stopped) return side;
    side.rise = deviance(problem_, set_, state_, minimum_, trial.u, beside.errors);
    if (!long_) return side;
    if (beside.remaining < long_step_left) side.rise -= beside.remaining * beside.remaining;
    opposite_ = std::move(trial);
    return side;
}

}  // namespace

Verdict judge(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
              const Posterior& posterior, const LatentCourse& course, const FullHessian& hessian, int& evaluations) {
    Verdict verdict;
    const auto distrust = [&](Eigen::Index i, const std::string& why) {
        verdict.trust = false;
        if (verdict.reason.empty()) verdict.reason = problem.parameters[static_cast<std::size_t>(i)].name + ": " + why;
    };
    if (hessian.known && !hessian.definite && !minimum.step.free.empty())
        distrust(minimum.step.free.front(), "the objective is not convex at the estimate");
    Sides sides(problem, set, state, minimum, course, evaluations);
    for (const Eigen::Index i : minimum.step.free) {
        // One reason is told, and looking for others costs minimisations of the whole.
        if (!verdict.trust || posterior.identifiable().undetermined[static_cast<std::size_t>(i)]) continue;
        const double ratio = hessian.ratio[i];
        if (ratio > most_ratio || ratio < 1.0 / most_ratio)
            distrust(i, "its sd from the full Hessian is " + two_figures(ratio) + " times the Gauss-Newton one");
        const double sd = std::sqrt(posterior.laplace()(i, i));
        if (!verdict.trust || !(sd > 0.0)) continue;
        double outside = 0.0;
        std::string roots;
        for (const double sign : {-1.0, 1.0}) {
            const std::string where = sign < 0.0 ? "below the estimate" : "above the estimate";
            const double u = state.u[i] + sign * reach * sd;
            if (!(u > problem.lower[i]) || !(u < problem.upper[i])) {
                distrust(i, "a bound lies within two sds " + where);
                break;
            }
            const Sides::Side side = sides.look(i, sign * reach / sd * posterior.laplace().col(i));
            if (side.outcome == Outcome::interrupted) return verdict;
            if (side.outcome == Outcome::start_failed || side.outcome == Outcome::blocks_stopped) {
                distrust(i, "cannot be evaluated two sds " + where);
                break;
            }
            const double root = std::sqrt(std::max(side.rise, 0.0));
            outside += beyond(root);
            if (!side.minimised) continue;
            roots += (roots.empty() ? "two sds " : ", ") + where + " the objective says " + two_figures(root) + " sds";
        }
        // Without roots both sides were as expected, or named already.
        if (!roots.empty() && !(outside >= least_outside && outside <= most_outside)) distrust(i, roots);
    }
    return verdict;
}

}  // namespace orbid::estimator
