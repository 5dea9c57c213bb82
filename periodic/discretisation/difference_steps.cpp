#include "periodic/discretisation/difference_steps.hpp"

#include <array>

#include "models/arithmetic/lu_factor.hpp"

namespace orbid::periodic {

SecondOrderSteps::SecondOrderSteps(const OrbitField& field, Index steps, const std::vector<Index>& velocity)
    : Discretisation(equidistant(steps), field.dimension(), field.autonomous()), field_(field) {
    for (std::size_t i = 0; i < velocity.size(); ++i)
        if (velocity[i] >= 0) {
            positions_.push_back(static_cast<Index>(i));
            velocities_.push_back(velocity[i]);
        }
}

StepImage SecondOrderSteps::state(Index j, const VectorXd& z, double time, std::span<const Index> free) const {
    const Index n = z.size();
    const auto half = static_cast<Index>(velocities_.size());
    const double h = 1.0 / static_cast<double>(steps());
    const std::array<double, 1> shares{share(j)};
    StepImage image;
    VectorXd x = z;
    // v - w - h/2 a(q, v) = 0: one step for damping linear in v, two or three otherwise. Errors square, so that what a
    // step changes by less than 1e-8 of v is settled.
    constexpr int most_steps = 20;
    for (int i = 0; i < most_steps; ++i) {
        const FieldValues g = field_.values(x, shares, time, {});
        if (!g.value.allFinite() || !g.by_state.allFinite()) return image;
        const VectorXd gap = z(velocities_) + 0.5 * h * g.value(velocities_, 0) - x(velocities_);
        const MatrixXd matrix = MatrixXd::Identity(half, half) - 0.5 * h * g.by_state(velocities_, velocities_);
        const VectorXd step = models::LuFactor(matrix).solve(gap);
        x(velocities_) += step;
        image.simulated = step.norm() <= 1e-8 * (x(velocities_).norm() + 1e-300);
        if (image.simulated || step.norm() == 0.0) break;
    }
    // Slower than that is no scheme but a step far too long.
    if (!image.simulated) return image;
    image.value = x;
    const FieldValues g = field_.values(x, shares, time, free);
    const models::LuFactor matrix(MatrixXd::Identity(half, half) - 0.5 * h * g.by_state(velocities_, velocities_));
    // dv = M^-1 (dw + h/2 (a_q dq + a_theta dtheta + a dlnT))
    MatrixXd right = MatrixXd::Zero(half, n);
    for (Index i = 0; i < half; ++i) {
        right(i, velocities_[static_cast<std::size_t>(i)]) = 1.0;
        for (const Index q : positions_)
            right(i, q) = 0.5 * h * g.by_state(velocities_[static_cast<std::size_t>(i)], q);
    }
    image.by_state = MatrixXd::Identity(n, n);
    const MatrixXd by_state = matrix.solve(right);
    image.by_state(velocities_, Eigen::all) = by_state;
    image.by_parameters = MatrixXd::Zero(n, static_cast<Index>(free.size()));
    if (!free.empty()) {
        const MatrixXd own = 0.5 * h * g.by_parameters(velocities_, Eigen::all);
        const MatrixXd slope = matrix.solve(own);
        image.by_parameters(velocities_, Eigen::all) = slope;
    }
    if (unknown_time()) {
        const VectorXd own = 0.5 * h * g.value(velocities_, 0);
        const VectorXd slope = matrix.solve(own);
        image.by_ln_time = VectorXd::Zero(n);
        image.by_ln_time(velocities_) = slope;
    }
    return image;
}

StepImage SecondOrderSteps::advance(Index j, const VectorXd& z, double time, std::span<const Index> free) const {
    StepImage image = state(j, z, time, free);
    if (!image.simulated) return image;
    const double step = field_.duration(time) / static_cast<double>(steps());
    // w+ = 2 v - w, q+ = q + h T w+
    image.value(velocities_) = 2.0 * image.value(velocities_) - z(velocities_);
    const VectorXd w = image.value(velocities_);
    image.value(positions_) = z(positions_) + step * w;
    MatrixXd by_state = 2.0 * image.by_state(velocities_, Eigen::all);
    for (Index i = 0; i < by_state.rows(); ++i)
        by_state(i, velocities_[static_cast<std::size_t>(i)]) -= 1.0;
    image.by_state(velocities_, Eigen::all) = by_state;
    image.by_state(positions_, Eigen::all) += step * by_state;
    if (!free.empty()) {
        const MatrixXd slope = 2.0 * image.by_parameters(velocities_, Eigen::all);
        image.by_parameters(velocities_, Eigen::all) = slope;
        image.by_parameters(positions_, Eigen::all) = step * (slope + w * field_.ln_duration_slopes(free));
    }
    if (unknown_time()) {
        const VectorXd slope = 2.0 * image.by_ln_time(velocities_);
        image.by_ln_time(velocities_) = slope;
        image.by_ln_time(positions_) = step * (slope + w);
    }
    return image;
}

StepImage CentredSteps::advance(Index j, const VectorXd& z, double time, std::span<const Index> free) const {
    const Index n = field_.dimension();
    const auto f = static_cast<Index>(free.size());
    const double step = 2.0 / static_cast<double>(steps());
    const std::array<double, 1> shares{share(j)};
    const FieldValues g = field_.values(z.tail(n), shares, time, free);
    StepImage image;
    image.simulated = true;
    image.value.resize(2 * n);
    image.value << z.tail(n), z.head(n) + step * g.value.col(0);
    image.by_state = MatrixXd::Zero(2 * n, 2 * n);
    image.by_state.topRightCorner(n, n).setIdentity();
    image.by_state.bottomLeftCorner(n, n).setIdentity();
    image.by_state.bottomRightCorner(n, n) = step * g.by_state;
    image.by_parameters = MatrixXd::Zero(2 * n, f);
    if (f > 0) image.by_parameters.bottomRows(n) = step * g.by_parameters;
    if (unknown_time()) {
        image.by_ln_time = VectorXd::Zero(2 * n);
        image.by_ln_time.tail(n) = step * g.value.col(0);
    }
    return image;
}

StepImage CentredSteps::state(Index /*j*/, const VectorXd& z, double /*time*/, std::span<const Index> free) const {
    const Index n = field_.dimension();
    StepImage image;
    image.simulated = true;
    image.value = z.tail(n);
    image.by_state = MatrixXd::Zero(n, 2 * n);
    image.by_state.rightCols(n).setIdentity();
    image.by_parameters = MatrixXd::Zero(n, static_cast<Index>(free.size()));
    if (unknown_time()) image.by_ln_time = VectorXd::Zero(n);
    return image;
}

std::vector<MatrixXd> CentredSteps::propagators(const std::vector<MatrixXd>& jacobians) const {
    // A step's Jacobian holds 2 h f_x.
    const Index n = field_.dimension();
    const MatrixXd one = MatrixXd::Identity(n, n);
    const std::size_t count = jacobians.size();
    std::vector<MatrixXd> factors;
    for (std::size_t k = 0; k < count; ++k) {
        const MatrixXd here = 0.25 * jacobians[k].bottomRightCorner(n, n);
        const MatrixXd there = 0.25 * jacobians[(k + 1) % count].bottomRightCorner(n, n);
        factors.push_back(models::LuFactor(one - there).solve(MatrixXd(one + here)));
    }
    return factors;
}

}  // namespace orbid::periodic
