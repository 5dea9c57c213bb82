#include "periodic/discretisation/gauss_steps.hpp"

#include <limits>

#include "models/arithmetic/lu_factor.hpp"

namespace orbid::periodic {

double GaussSteps::width(Index j) const {
    return (j + 1 < steps() ? share(j + 1) : 1.0) - share(j);
}

std::vector<double> GaussSteps::instants(Index j) const {
    std::vector<double> result;
    for (Index i = 0; i < method_.nodes.size(); ++i)
        result.push_back(share(j) + method_.nodes(i) * width(j));
    return result;
}

MatrixXd GaussSteps::states(Index j, const VectorXd& z, const MatrixXd& slopes) const {
    return (width(j) * slopes * method_.matrix.transpose()).colwise() + z;
}

MatrixXd GaussSteps::matrix(Index j, const MatrixXd& by_state) const {
    const Index n = field_.dimension();
    const Index m = method_.nodes.size();
    MatrixXd result = MatrixXd::Identity(n * m, n * m);
    for (Index i = 0; i < m; ++i)
        for (Index l = 0; l < m; ++l)
            result.block(n * i, n * l, n, n) -= width(j) * method_.matrix(i, l) * by_state.middleCols(n * i, n);
    return result;
}

MatrixXd GaussSteps::slopes(Index j, const VectorXd& z, double time) const {
    const Index m = method_.nodes.size();
    const std::vector<double> shares = instants(j);
    MatrixXd k = field_.value(z.replicate(1, m), shares, time);
    // Squares its error from step to step; an interval that takes more is far too long for its polynomial.
    constexpr int most_steps = 15;
    for (int i = 0; i < most_steps; ++i) {
        const FieldValues g = field_.values(states(j, z, k), shares, time, {});
        if (!g.value.allFinite() || !g.by_state.allFinite()) return {};
        const VectorXd gap = (g.value - k).reshaped();
        const VectorXd step = models::LuFactor(matrix(j, g.by_state)).solve(gap);
        k += step.reshaped(k.rows(), m);
        const double size = step.norm() / (k.norm() + std::numeric_limits<double>::min());
        // What is left after a step of 1e-9 is its square.
        if (size <= 1e-9) return k;
    }
    return {};
}

StepImage GaussSteps::advance(Index j, const VectorXd& z, double time, std::span<const Index> free) const {
    const Index n = field_.dimension();
    const Index m = method_.nodes.size();
    const auto f = static_cast<Index>(free.size());
    StepImage image;
    const MatrixXd k = slopes(j, z, time);
    if (k.size() == 0) return image;
    image.simulated = true;
    image.value = z + width(j) * k * method_.weights;

    // d k = (1 - h a J)^-1 (J dx + G_theta dtheta + G dlnT)
    const FieldValues g = field_.values(states(j, z, k), instants(j), time, free);
    MatrixXd right(n * m, n + f + (unknown_time() ? 1 : 0));
    for (Index i = 0; i < m; ++i) {
        right.block(n * i, 0, n, n) = g.by_state.middleCols(n * i, n);
        if (f > 0) right.block(n * i, n, n, f) = g.by_parameters.middleCols(f * i, f);
        if (unknown_time()) right.block(n * i, n + f, n, 1) = g.value.col(i);
    }
    const MatrixXd slope = models::LuFactor(matrix(j, g.by_state)).solve(right);
    MatrixXd derivative = MatrixXd::Zero(n, right.cols());
    for (Index i = 0; i < m; ++i)
        derivative += width(j) * method_.weights(i) * slope.middleRows(n * i, n);
    image.by_state = MatrixXd::Identity(n, n) + derivative.leftCols(n);
    image.by_parameters = derivative.middleCols(n, f);
    if (unknown_time()) image.by_ln_time = derivative.rightCols(1);
    return image;
}

}  // namespace orbid::periodic
