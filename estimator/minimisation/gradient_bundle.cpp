#include "estimator/minimisation/gradient_bundle.hpp"

#include <algorithm>

#include "models/arithmetic/orthogonal_factor.hpp"

namespace orbid::estimator {

GradientBundle::GradientBundle(const Eigen::MatrixXd& hessian) : gradients_(hessian.rows(), 0) {
    // In units in which the diagonal is 1, so that the rank does not depend on those of the parameters.
    Eigen::VectorXd unit = hessian.diagonal().cwiseSqrt();
    for (double& one : unit)
        one = one > 0.0 ? 1.0 / one : 0.0;
    const Eigen::MatrixXd scaled = unit.asDiagonal() * hessian * unit.asDiagonal();
    inverse_ = unit.asDiagonal() * models::CompleteFactor(scaled).pseudo_inverse() * unit.asDiagonal();
}

void GradientBundle::add(const Eigen::VectorXd& gradient) {
    gradients_.conservativeResize(Eigen::NoChange, gradients_.cols() + 1);
    gradients_.rightCols(1) = gradient;
}

Eigen::VectorXd GradientBundle::step() const {
    const Eigen::MatrixXd steps = inverse_ * gradients_;
    const Eigen::MatrixXd products = gradients_.transpose() * steps;
    return -steps * least_convex_combination(0.5 * (products + products.transpose()));
}

Eigen::VectorXd least_convex_combination(const Eigen::MatrixXd& q) {
    const Eigen::Index n = q.rows();
    const double least = 1e-12 * q.cwiseAbs().maxCoeff();
    Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
    Eigen::Index best = 0;
    q.diagonal().minCoeff(&best);
    x[best] = 1.0;
    // Weight goes from the worst vertex in use to the best one (pairwise Frank-Wolfe): linear convergence, and a
    // handful of vertices.
    constexpr int limit = 10000;
    for (int iteration = 0; iteration < limit; ++iteration) {
        const Eigen::VectorXd gradient = q * x;
        Eigen::Index to = 0;
        gradient.minCoeff(&to);
        Eigen::Index from = -1;
        for (Eigen::Index i = 0; i < n; ++i)
            if (x[i] > 0.0 && (from < 0 || gradient[i] > gradient[from])) from = i;
        const double gain = gradient[from] - gradient[to];
        if (!(gain > least)) break;
        const double bend = q(to, to) + q(from, from) - 2.0 * q(to, from);
        const double step = bend > 0.0 ? std::min(x[from], gain / bend) : x[from];
        x[to] += step;
        x[from] = step < x[from] ? x[from] - step : 0.0;
    }
    return x;
}

}  // namespace orbid::estimator
