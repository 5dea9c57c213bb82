#include "orbits/spline_map/reading_smoother.hpp"

#include <cmath>
#include <utility>

#include "models/arithmetic/lu_factor.hpp"

namespace orbid::orbits {
namespace {

// Blocks of the inverse below this part of the diagonal ones are negligible: the normal equations are then off by less
// than their rounding in the worst direction (A of norm 30 makes V uneven by 1e3). No farther than this many steps.
constexpr double negligible = 1e-5;
constexpr std::size_t farthest = 40;

}  // namespace

ReadingSmoother::ReadingSmoother(std::vector<SeriesStep> steps, const Eigen::MatrixXd& reading_covariance, double gate)
    : steps_(std::move(steps)), reading_(reading_covariance) {
    const std::size_t count = steps_.size();
    const Eigen::Index n = reading_.rows();
    coupling_.resize(count);
    forward_.resize(count);
    backward_.resize(count);
    diagonal_.resize(count);
    for (std::size_t t = 0; t < count; ++t)
        if (linked(t)) coupling_[t] = -reading_ * steps_[t + 1].jacobian.transpose();

    std::vector<SmallMatrix> variance(count);
    SmallVector innovation(n);
    for (std::size_t t = 0; t < count; ++t) {
        SeriesStep& step = steps_[t];
        if (!step.present) continue;
        variance[t] = step.model + reading_ + step.jacobian * reading_ * step.jacobian.transpose();
        SmallMatrix reduced = variance[t];
        if (t > 0 && linked(t - 1)) {
            const SmallMatrix gain = coupling_[t - 1].transpose() * forward_[t - 1];
            reduced -= gain * coupling_[t - 1];
            innovation = SmallVector(step.residual - gain * innovation);
        } else {
            innovation = step.residual;
        }
        forward_[t] = models::inverse(reduced);
        const double chi2 = innovation.dot(forward_[t] * innovation);
        if (!(chi2 <= gate)) {
            // chi2 / (1 + share chi2) = gate
            const SmallMatrix raised = (1.0 / gate - 1.0 / chi2) * innovation * innovation.transpose();
            step.model += raised;
            variance[t] += raised;
            forward_[t] = models::inverse(SmallMatrix(reduced + raised));
            ++gated_;
        }
    }
    for (std::size_t t = count; t-- > 0;) {
        if (!steps_[t].present) continue;
        SmallMatrix reduced = variance[t];
        if (linked(t)) reduced -= coupling_[t] * backward_[t + 1] * coupling_[t].transpose();
        backward_[t] = models::inverse(reduced);
        SmallMatrix both = reduced;
        if (t > 0 && linked(t - 1)) both -= coupling_[t - 1].transpose() * forward_[t - 1] * coupling_[t - 1];
        diagonal_[t] = models::inverse(both);
        diagonal_[t] = SmallMatrix(0.5 * (diagonal_[t] + diagonal_[t].transpose()));
    }
}

Eigen::MatrixXd ReadingSmoother::weighted(const Eigen::MatrixXd& residuals) const {
    const std::size_t count = steps_.size();
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(residuals.rows(), residuals.cols());
    for (std::size_t t = 0; t < count; ++t) {
        if (!steps_[t].present) continue;
        const auto at = static_cast<Eigen::Index>(t);
        SmallVector reduced = residuals.col(at);
        if (t > 0 && linked(t - 1)) reduced -= coupling_[t - 1].transpose() * result.col(at - 1);
        result.col(at) = forward_[t] * reduced;
    }
    for (std::size_t t = count; t-- > 0;) {
        if (!linked(t)) continue;
        const auto at = static_cast<Eigen::Index>(t);
        result.col(at) -= forward_[t] * (coupling_[t] * result.col(at + 1));
    }
    return result;
}

Eigen::MatrixXd ReadingSmoother::reading_errors(const Eigen::MatrixXd& weighted) const {
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(weighted.rows(), weighted.cols());
    for (std::size_t t = 0; t < steps_.size(); ++t) {
        const auto at = static_cast<Eigen::Index>(t);
        SmallVector pull = SmallVector::Zero(weighted.rows());
        if (t > 0 && steps_[t - 1].present) pull += weighted.col(at - 1);
        if (steps_[t].present) pull -= steps_[t].jacobian.transpose() * weighted.col(at);
        result.col(at) = reading_ * pull;
    }
    return result;
}

SmallMatrix ReadingSmoother::remaining_covariance(std::size_t t) const {
    const Eigen::Index n = reading_.rows();
    SmallMatrix known = SmallMatrix::Zero(n, n);
    const bool before = t > 0 && steps_[t - 1].present, after = steps_[t].present;
    if (before) known += diagonal_[t - 1];
    if (after) known += steps_[t].jacobian.transpose() * diagonal_[t] * steps_[t].jacobian;
    if (before && after) {
        const SmallMatrix across = -diagonal_[t - 1] * coupling_[t - 1] * backward_[t];  // (V^-1)_{t-1,t}
        const SmallMatrix product = across * steps_[t].jacobian;
        known -= product + product.transpose();
    }
    return reading_ - reading_ * known * reading_;
}

void ReadingSmoother::inverse_row(std::size_t t, std::vector<SmallMatrix>& row) const {
    row.clear();
    row.push_back(diagonal_[t]);
    for (std::size_t s = t; linked(s) && row.size() <= farthest; ++s) {
        row.emplace_back(-row.back() * coupling_[s] * backward_[s + 1]);
        if (row.back().norm() < negligible * std::sqrt(diagonal_[t].norm() * diagonal_[s + 1].norm())) break;
    }
}

}  // namespace orbid::orbits
