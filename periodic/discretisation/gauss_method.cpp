#include "periodic/discretisation/gauss_method.hpp"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

namespace orbid::periodic {

namespace {

/// Zero of the Legendre polynomial of degree m on [-1, 1] nearest to x, and the weight that belongs to it.
void refine_zero(int m, double& x, double& weight) {
    double slope = 1.0;
    for (int i = 0; i < 20; ++i) {  // squares its error; six steps are enough from the cosine below
        double before = 1.0;
        double value = x;
        for (int k = 2; k <= m; ++k) {
            const double next = ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k;
            before = value;
            value = next;
        }
        slope = m * (x * value - before) / (x * x - 1.0);
        const double step = value / slope;
        x -= step;
        if (std::abs(step) < 1e-16) break;
    }
    weight = 2.0 / ((1.0 - x * x) * slope * slope);
}

double lagrange(const VectorXd& nodes, Index j, double u) {
    double product = 1.0;
    for (Index i = 0; i < nodes.size(); ++i)
        if (i != j) product *= (u - nodes(i)) / (nodes(j) - nodes(i));
    return product;
}

}  // namespace

VectorXd GaussMethod::integrals(double u) const {
    // The rule itself is exact for them: their degree is m - 1.
    VectorXd result = VectorXd::Zero(nodes.size());
    for (Index j = 0; j < nodes.size(); ++j)
        for (Index q = 0; q < nodes.size(); ++q)
            result(j) += u * weights(q) * lagrange(nodes, j, u * nodes(q));
    return result;
}

VectorXd GaussMethod::highest_derivatives() const {
    VectorXd result(nodes.size());
    for (Index j = 0; j < nodes.size(); ++j) {
        double value = 1.0;
        double factorial = 1.0;
        for (Index i = 0; i < nodes.size(); ++i)
            if (i != j) value /= nodes(j) - nodes(i);
        for (Index k = 2; k < nodes.size(); ++k)
            factorial *= static_cast<double>(k);
        result(j) = factorial * value;
    }
    return result;
}

GaussMethod gauss_method(int stages) {
    if (stages < 1 || stages > 10)
        throw std::invalid_argument("Gauss's method: stages is " + std::to_string(stages) + ", must lie in [1, 10]");
    GaussMethod method;
    method.nodes.resize(stages);
    method.weights.resize(stages);
    for (int i = 0; i < stages; ++i) {
        double x = -std::cos(std::numbers::pi * (i + 0.75) / (stages + 0.5));
        double weight = 0.0;
        if (stages == 1)
            x = 0.0, weight = 2.0;
        else
            refine_zero(stages, x, weight);
        method.nodes(i) = 0.5 * (1.0 + x);
        method.weights(i) = 0.5 * weight;
    }
    method.matrix.resize(stages, stages);
    for (int i = 0; i < stages; ++i)
        method.matrix.row(i) = method.integrals(method.nodes(i)).transpose();
    return method;
}

}  // namespace orbid::periodic
