#include "estimator/minimisation/error_parameter.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/algebra/block_loop.hpp"
#include "estimator/minimisation/row_coordinate.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// s^T P s summed over some rows s, P of the leading columns.
double leverage(const Eigen::Ref<const Eigen::MatrixXd>& rows, const Eigen::Ref<const Eigen::MatrixXd>& covariance,
                Eigen::Index first, Eigen::Index count) {
    double sum = 0.0;
    for (Eigen::Index i = first; i < first + count; ++i)
        for (Eigen::Index j = 0; j < covariance.cols(); ++j) {
            double column = 0.0;
            for (Eigen::Index k = 0; k < covariance.rows(); ++k)
                column += covariance(k, j) * rows(i, k);
            sum += column * rows(i, j);
        }
    return sum;
}

/// tr(P S^T dS / dpsi_k) of every coordinate of every block's rows, own ones first, then those of linked records.
struct Traces {
    std::vector<std::size_t> own;     ///< per block
    std::vector<std::size_t> linked;  ///< likewise
    std::vector<double> value;
};

Traces traces(const ErrorProblem& problem, const Eigen::VectorXd& psi, const ErrorPoint& point) {
    Traces result;
    std::size_t count = 0;
    bool any_linked = false;
    for (const BlockRows& block : *problem.rows) {
        result.own.push_back(count);
        for_coordinates(*problem.laws, problem.free, block, block.parts, [&](const RowCoordinate&) { ++count; });
        result.linked.push_back(count);
        if (!block.linked_parts.empty())
            for_coordinates(*problem.laws, problem.free, block, block.linked_parts,
                            [&](const RowCoordinate&) { ++count; });
        any_linked = any_linked || count > result.linked.back();
    }
    result.value.assign(count, 0.0);
    if (count == 0 && problem.set->spread.alone()) return result;
    const auto use = [&](std::size_t b, const std::vector<PartRows>& parts, std::size_t slot,
                         const Eigen::Ref<const Eigen::MatrixXd>& rows,
                         const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
        if (rows.rows() == 0 || covariance.cols() == 0) return;
        for_coordinates(*problem.laws, problem.free, (*problem.rows)[b], parts, [&](const RowCoordinate& coordinate) {
            if (coordinate.plain) {
                result.value[slot++] = -leverage(rows, covariance, coordinate.first, coordinate.rows);
                return;
            }
            const WhitenedRows derivative = standard_rows_derivative((*problem.rows)[b], parts, *problem.laws, psi,
                                                                     coordinate.k, Curvature::expected, {rows, 0.0});
            const auto columns = covariance.cols();
            result.value[slot++] =
                derivative.rows.leftCols(columns).cwiseProduct(rows.leftCols(columns) * covariance).sum();
        });
    };
    const CovarianceUse own = [&](std::size_t b, const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
        use(b, (*problem.rows)[b].parts, result.own[b], point.standard.own_rows(b), covariance);
    };
    const CovarianceUse linked = [&](std::size_t b, const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
        if ((*problem.rows)[b].linked_parts.empty()) return;
        use(b, (*problem.rows)[b].linked_parts, result.linked[b], point.standard.linked_rows(b), covariance);
    };
    visit_covariance(point.standard.arrow, point.reduced_problem, parameter_covariance(problem, point), own,
                     any_linked ? linked : CovarianceUse());
    return result;
}

/// The contribution of some rows of a block to the gradient.
struct RowSums {
    Eigen::VectorXd gradient;
    Eigen::VectorXd fit;
    Eigen::VectorXd left;
};

/// @param slot   of the rows' first trace. @param w  memory for the errors.
/// @param moved  errors follow these steps of everything the rows depend on, under each other; empty: they stay.
void add_rows(const ErrorProblem& problem, const Eigen::VectorXd& psi, const BlockRows& block,
              const std::vector<PartRows>& parts, const Eigen::Ref<const Eigen::MatrixXd>& at, const double* slot,
              const Eigen::VectorXd& moved, Eigen::VectorXd& w, RowSums& sums) {
    if (at.rows() == 0) return;
    const std::vector<NoiseModel>& laws = *problem.laws;
    const Eigen::Index last = at.cols() - 1;
    w = at.col(last);
    for (Eigen::Index j = 0; j < moved.size(); ++j)
        for (Eigen::Index i = 0; i < w.size(); ++i)
            w[i] += at(i, j) * moved[j];
    for_coordinates(*problem.laws, problem.free, block, parts, [&](const RowCoordinate& coordinate) {
        const Eigen::Index k = coordinate.k;
        const double trace = *slot++;
        if (coordinate.plain) {
            // S = A / s: d(-ln p) = n - sum of squares, and (M10)'s trace is that of the rows' own covariance.
            const auto count = static_cast<double>(coordinate.part->records.count);
            const double fit = w.segment(coordinate.first, coordinate.rows).squaredNorm();
            sums.gradient[k] += count - fit + trace;
            sums.fit[k] += fit;
            sums.left[k] += count + trace;
            return;
        }
        const WhitenedRows derivative =
            standard_rows_derivative(block, parts, laws, psi, k, Curvature::expected, {at, 0.0});
        double fit = derivative.value;
        if (moved.size() > 0)
            fit += w.dot(derivative.rows.col(last) + derivative.rows.leftCols(last) * moved) -
                   at.col(last).dot(derivative.rows.col(last));
        sums.gradient[k] += fit + trace;
        // The scale of a law that sees sums of squares only, in a block with a covariance shape.
        const auto law = std::find_if(laws.begin(), laws.end(), [k](const NoiseModel& one) { return one.first == k; });
        if (coordinate.part != nullptr || law == laws.end() || !law->compressible()) return;
        const auto count =
            static_cast<double>(std::count(block.channel.begin(), block.channel.end(), law->channels.front()));
        // d(-ln p) = n - fit for the scale of such a law.
        sums.fit[k] += count - fit;
        sums.left[k] += count + trace;
    });
}

/// @param rhs  of the determined parameters, see ErrorPoint::triangle.
ErrorStep followed(const ErrorProblem& problem, const ErrorPoint& point, const Eigen::VectorXd& rhs) {
    ErrorStep step;
    const bool all = problem.follow == Follow::all && rhs.size() > 0;
    if (!all && problem.set->latents == 0) return step;
    step.y = problem.prior_gradient;
    if (all) {
        models::solve_transposed_upper_in_place(point.triangle, step.y);
        step.y = -(step.y + rhs);
        models::solve_upper_in_place(point.triangle, step.y);
    } else {
        step.y.setZero();
    }
    step.u = problem.basis * step.y;
    step.d_z = latent_steps(point.standard.arrow, point.reduced_problem, step.u);
    return step;
}

/// Adds the contributions of all rows to the gradient.
void add_all_rows(const ErrorProblem& problem, const Eigen::VectorXd& psi, ErrorPoint& point) {
    const ErrorStep& step = point.step;
    const Traces trace = traces(problem, psi, point);
    const RowSums zero{Eigen::VectorXd::Zero(psi.size()), Eigen::VectorXd::Zero(psi.size()),
                       Eigen::VectorXd::Zero(psi.size())};
    const bool moving = !step.d_z.empty();
    std::vector<RowSums> sums(pieces_of(problem.rows->size()), zero);
    for_pieces(problem.rows->size(), [&](std::size_t begin, std::size_t end, std::size_t piece) {
        // One vector for each kind of rows: a vector that changes its length asks for memory each time.
        Eigen::VectorXd own_step, linked_step, own_errors, linked_errors;
        for (std::size_t b = begin; b < end; ++b) {
            const BlockRows& block = (*problem.rows)[b];
            if (moving) {
                own_step.resize(step.d_z[b].size() + step.u.size());
                own_step << step.d_z[b], step.u;
            }
            add_rows(problem, psi, block, block.parts, point.standard.own_rows(b), trace.value.data() + trace.own[b],
                     own_step, own_errors, sums[piece]);
            if (block.linked_parts.empty()) continue;
            if (moving) {
                const Eigen::VectorXd& next = step.d_z[static_cast<std::size_t>(block.next)];
                linked_step.resize(step.d_z[b].size() + next.size() + step.u.size());
                linked_step << step.d_z[b], next, step.u;
            }
            add_rows(problem, psi, block, block.linked_parts, point.standard.linked_rows(b),
                     trace.value.data() + trace.linked[b], linked_step, linked_errors, sums[piece]);
        }
    });
    point.gradient = zero.gradient;
    point.fit = zero.fit;
    point.left = zero.left;
    for (const RowSums& part : sums) {
        point.gradient += part.gradient;
        point.fit += part.fit;
        point.left += part.left;
    }
    for (Eigen::VectorXd* all : {&point.gradient, &point.fit, &point.left})
        problem.set->spread.sum(*all);
}

void add_error_priors(const ErrorProblem& problem, const Eigen::VectorXd& psi, ErrorPoint& point) {
    for (const NoiseModel& law : *problem.laws) {
        const auto free = problem.free.begin() + law.first;
        if (std::find(free, free + law.size(), true) == free + law.size()) continue;
        const Eigen::VectorXd own = law.own(psi);
        point.value += prior_term(law, own);
        for (Eigen::Index j = 0; j < law.size(); ++j)
            if (free[j]) point.gradient[law.first + j] += prior_slope(law, own, j);
    }
}

}  // namespace

Eigen::MatrixXd parameter_covariance(const ErrorProblem& problem, const ErrorPoint& point) {
    if (!problem.restricted) return {};
    return problem.basis * inverse_square(point.triangle) * problem.basis.transpose();
}

ErrorPoint evaluate_errors(const ErrorProblem& problem, const Eigen::VectorXd& psi) {
    return evaluate_errors(
        problem, psi,
        standard_arrow(*problem.set, *problem.rows, *problem.laws, psi, problem.matching, Curvature::expected, true));
}

ErrorPoint evaluate_errors(const ErrorProblem& problem, const Eigen::VectorXd& psi, WhitenedArrow standard) {
    const Eigen::Index rank = problem.prior_gradient.size();
    ErrorPoint point;
    point.standard = std::move(standard);
    point.reduced_problem = condense(point.standard.arrow, 0.0);
    point.value = point.standard.value;

    // The determined parameters with their prior: R factor and best step y.
    Eigen::MatrixXd stacked(problem.basis.rows() + problem.prior_rows.rows(), rank + 1);
    stacked << point.reduced_problem.r * problem.basis, point.reduced_problem.rhs, problem.prior_rows,
        Eigen::VectorXd::Zero(problem.prior_rows.rows());
    const Eigen::MatrixXd factor = upper_triangle(std::move(stacked));
    point.triangle = factor.topLeftCorner(rank, rank);
    point.rest = point.reduced_problem.rest * point.reduced_problem.rest + factor(rank, rank) * factor(rank, rank);
    point.step = followed(problem, point, factor.topRightCorner(rank, 1));
    const ErrorStep& step = point.step;
    if (!step.d_z.empty()) {
        const ModelChange change = model_change(point.standard.arrow, step.u, step.d_z);
        point.value += change.linear + 0.5 * change.quadratic + problem.prior_gradient.dot(step.y) +
                       0.5 * (problem.prior_rows * step.y).squaredNorm();
    }
    if (problem.restricted) point.value += point.triangle.diagonal().array().abs().log().sum();
    point.value += log_abs_determinant(point.reduced_problem);
    add_all_rows(problem, psi, point);
    add_error_priors(problem, psi, point);
    return point;
}

namespace {

/// Whether one scale s whitens everything: the whole problem is then that of s = 1 divided by s, and
/// Phi_psi = const + n ln s + ||e||^2 / (2 s^2) with other n where parameters or states are integrated.
bool one_scale_for_all(const ErrorProblem& problem, const std::vector<Eigen::Index>& free) {
    if (problem.laws->size() != 1 || free.size() != 1 || problem.set->constraints > 0) return false;
    const NoiseModel& law = problem.laws->front();
    return law.compressible() && std::holds_alternative<FlatPrior>(law.coordinates.front().prior) &&
           problem.prior_rows.isZero(0.0) && problem.prior_gradient.isZero(0.0);
}

}  // namespace

bool is_long(const BlockSet& set) {
    constexpr std::size_t many_blocks = 1000;
    return set.all_blocks >= many_blocks || (set.latents > 0 && set.records >= many_records);
}

Eigen::MatrixXd error_hessian(const ErrorProblem& problem, const ErrorPoint& point, const Eigen::VectorXd& psi,
                              const std::vector<Eigen::Index>& free) {
    if (one_scale_for_all(problem, free)) {
        const double square = problem.follow == Follow::all ? point.rest : point.fit[free.front()];
        return Eigen::MatrixXd::Constant(1, 1, 2.0 * square);
    }
    // Four points: error h^4 / 30 of a fifth derivative that is about 64 n, against rounding / h. Two points: error h^2
    // / 6 of a third one that is about 8 n, a millionth. That is enough where each of them takes long.
    constexpr double h = 1e-3;
    using Points = std::vector<std::pair<double, double>>;
    const Points points = is_long(*problem.set)
                              ? Points{{-1.0, -0.5}, {1.0, 0.5}}
                              : Points{{-2.0, 1.0 / 12.0}, {-1.0, -8.0 / 12.0}, {1.0, 8.0 / 12.0}, {2.0, -1.0 / 12.0}};
    const auto count = static_cast<Eigen::Index>(free.size());
    Eigen::MatrixXd hessian(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const Eigen::Index k = free[static_cast<std::size_t>(i)];
        Eigen::VectorXd slope = Eigen::VectorXd::Zero(psi.size());
        for (const auto& [at, weight] : points) {
            Eigen::VectorXd shifted = psi;
            shifted[k] += at * h;
            slope += weight / h * evaluate_errors(problem, shifted).gradient;
        }
        for (Eigen::Index j = 0; j < count; ++j)
            hessian(j, i) = slope[free[static_cast<std::size_t>(j)]];
    }
    return 0.5 * (hessian + hessian.transpose());
}

}  // namespace orbid::estimator
