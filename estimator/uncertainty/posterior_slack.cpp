#include <span>

#include "estimator/uncertainty/posterior.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

/// Records whose errors are in truth zero hold parameters with their scale's weight, but add no scatter. With J_s their
/// whitened rows the covariance H^-1 becomes H^-1 (H - J_s^T J_s) H^-1.
void Posterior::leave_out_slack() {
    const Eigen::Index rank = point_.triangle.rows();
    std::vector<bool> slack(problem_.laws.size(), false);
    bool any = false;
    for (std::size_t k = 0; k < problem_.laws.size(); ++k) {
        const NoiseModel& law = problem_.laws[k];
        const auto scale = static_cast<std::size_t>(law.first);
        slack[k] = law.slack || (group_of(problem_, law.channels.front()).slack && minimum_.error_at_floor[scale]);
        any = any || slack[k];
    }
    if (!any || rank == 0) return;
    Eigen::MatrixXd steps = Eigen::MatrixXd::Identity(rank, rank);
    models::solve_transposed_upper_in_place(point_.triangle, steps);
    models::solve_upper_in_place(point_.triangle, steps);
    steps = errors_.basis * steps;
    const BlockArrow& arrow = point_.standard.arrow;
    const std::vector<Eigen::VectorXd> still =
        latent_steps(arrow, point_.reduced_problem, Eigen::VectorXd::Zero(steps.rows()));
    std::vector<std::vector<Eigen::VectorXd>> moved;
    for (Eigen::Index j = 0; j < rank; ++j)
        moved.push_back(latent_steps(arrow, point_.reduced_problem, steps.col(j)));
    slack_ = Eigen::MatrixXd::Zero(rank, rank);
    for (std::size_t b = 0; b < minimum_.rows.size(); ++b) {
        const BlockRows& rows = minimum_.rows[b];
        if (rows.linked_parts.empty()) continue;
        const auto next = static_cast<std::size_t>(rows.next);
        Eigen::MatrixXd step(rows.latents + rows.next_latents + steps.rows(), rank);
        for (Eigen::Index j = 0; j < rank; ++j) {
            const std::vector<Eigen::VectorXd>& of = moved[static_cast<std::size_t>(j)];
            step.col(j) << of[b] - still[b], of[next] - still[next], steps.col(j);
        }
        const Eigen::MatrixXd at = point_.standard.linked_rows(b).leftCols(step.rows()).lazyProduct(step);
        Eigen::Index first = 0;
        for (const PartRows& part : rows.linked_parts) {
            const Eigen::Index count = part.records.rows.rows() * problem_.laws[part.law].rows_per_record();
            if (slack[part.law]) slack_ += at.middleRows(first, count).transpose() * at.middleRows(first, count);
            first += count;
        }
    }
    set_.spread.sum(std::span<double>(slack_.data(), static_cast<std::size_t>(slack_.size())));
    covariance_ -= minimum_.step.decided * slack_ * minimum_.step.decided.transpose();
}

}  // namespace orbid::estimator
