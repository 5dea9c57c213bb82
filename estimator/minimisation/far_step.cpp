#include "estimator/minimisation/far_step.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// [S_z S] P of every block without the undetermined latent states, and of the rows that link it to the next one.
struct CovarianceRows {
    std::vector<Eigen::MatrixXd> own;
    std::vector<Eigen::MatrixXd> linked;
};

CovarianceRows covariance_rows(const ErrorProblem& problem, const ErrorPoint& point) {
    using Rows = Eigen::Ref<const Eigen::MatrixXd>;
    const auto through = [](const Rows& at, const Rows& p) {
        Eigen::MatrixXd result;
        if (at.rows() > 0 && p.cols() > 0) result.noalias() = at.leftCols(p.cols()) * p;
        return result;
    };
    CovarianceRows result;
    result.own.resize(problem.rows->size());
    result.linked.resize(problem.rows->size());
    visit_covariance(
        point.standard.arrow, point.reduced_problem, parameter_covariance(problem, point),
        [&](std::size_t b, const Rows& p) { result.own[b] = through(point.standard.own_rows(b), p); },
        [&](std::size_t b, const Rows& p) {
            if (point.standard.linked_records[b] > 0) result.linked[b] = through(point.standard.linked_rows(b), p);
        });
    return result;
}

/// (M10) for a full covariance: V = [sum_i (e_i e_i^T + J_i C J_i^T) + Psi] / (n + nu + m + 1), as a step of psi.
void joint_step(const ErrorProblem& problem, const ErrorPoint& point, const NoiseModel& law, std::size_t index,
                const Eigen::VectorXd& psi, const CovarianceRows& spread, Eigen::VectorXd& step) {
    const auto m = static_cast<Eigen::Index>(law.channels.size());
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(m, m);
    double records = 0.0;
    const auto add = [&](const std::vector<PartRows>& parts, const Eigen::Ref<const Eigen::MatrixXd>& standard,
                         const Eigen::MatrixXd& through) {
        Eigen::Index row = 0;
        for (const PartRows& part : parts) {
            const Eigen::Index rows = part.records.rows.rows() * (*problem.laws)[part.law].rows_per_record();
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
    for (std::size_t b = 0; b < problem.rows->size(); ++b) {
        add((*problem.rows)[b].parts, point.standard.own_rows(b), spread.own[b]);
        add((*problem.rows)[b].linked_parts, point.standard.linked_rows(b), spread.linked[b]);
    }
    problem.set->spread.sum(std::span<double>(sum.data(), static_cast<std::size_t>(sum.size())));
    records = problem.set->spread.sum(records);
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

}  // namespace

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
    CovarianceRows through;
    for (std::size_t l = 0; l < problem.laws->size(); ++l) {
        const NoiseModel& law = (*problem.laws)[l];
        if (!law.joint() || !problem.free[static_cast<std::size_t>(law.first)]) continue;
        if (through.own.empty()) through = covariance_rows(problem, point);
        joint_step(problem, point, law, l, psi, through, own);
    }
    std::vector<Eigen::VectorXd> steps;
    if (own.lpNorm<Eigen::Infinity>() > 0.0) steps.push_back(own);
    // The same for all scales together: exact where a shape ties them to each other.
    if (fit > 0.0 && left > 1e-3 && common.sum() > 1.5) steps.push_back(common * (0.5 * std::log(fit / left)));
    return steps;
}

}  // namespace orbid::estimator
