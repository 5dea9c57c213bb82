#include "periodic/discretisation/collocation_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace orbid::periodic {

namespace {

double width_of(const std::vector<double>& mesh, std::size_t j) {
    return (j + 1 < mesh.size() ? mesh[j + 1] : 1.0) - mesh[j];
}

}  // namespace

MatrixXd PiecewisePolynomial::at(const std::vector<double>& shares, const GaussMethod& method) const {
    MatrixXd states(nodes.rows(), static_cast<Index>(shares.size()));
    std::size_t j = 0;
    for (std::size_t k = 0; k < shares.size(); ++k) {
        while (j + 1 < mesh.size() && mesh[j + 1] <= shares[k])
            ++j;
        const double width = width_of(mesh, j);
        states.col(static_cast<Index>(k)) =
            nodes.col(static_cast<Index>(j)) + width * slopes[j] * method.integrals((shares[k] - mesh[j]) / width);
    }
    return states;
}

PiecewisePolynomial piecewise_polynomial(const GaussSteps& steps, const MatrixXd& nodes, double time) {
    PiecewisePolynomial result;
    result.mesh = steps.shares();
    result.nodes = nodes;
    for (Index j = 0; j < steps.steps(); ++j) {
        result.slopes.push_back(steps.slopes(j, nodes.col(j), time));
        if (result.slopes.back().size() == 0) {
            result.slopes.clear();
            return result;
        }
    }
    return result;
}

std::vector<double> equidistributed(const PiecewisePolynomial& solution, const GaussMethod& method,
                                    const VectorXd& scale) {
    const std::size_t count = solution.mesh.size();
    const auto m = static_cast<double>(method.nodes.size());
    // The m-th derivative on each interval, a constant.
    std::vector<VectorXd> highest;
    for (std::size_t j = 0; j < count; ++j)
        highest.push_back(solution.slopes[j] * method.highest_derivatives() /
                          std::pow(width_of(solution.mesh, j), m - 1.0));
    std::vector<double> jump(count);  // of its size per share, between interval j and the next
    for (std::size_t j = 0; j < count; ++j) {
        const std::size_t next = (j + 1) % count;
        const double distance = 0.5 * (width_of(solution.mesh, j) + width_of(solution.mesh, next));
        jump[j] = ((highest[next] - highest[j]).array() / scale.array()).matrix().norm() / distance;
    }
    std::vector<double> density(count);
    double total = 0.0;
    for (std::size_t j = 0; j < count; ++j) {
        const double mean = 0.5 * (jump[j] + jump[(j + count - 1) % count]);
        density[j] = std::pow(mean, 1.0 / (m + 1.0));
        total += density[j] * width_of(solution.mesh, j);
    }
    // No interval becomes more than five times the mean length: the estimate may vanish where the motion does not.
    constexpr double least = 0.2;
    double whole = 0.0;
    for (std::size_t j = 0; j < count; ++j) {
        density[j] = (1.0 - least) * density[j] + least * total;
        whole += density[j] * width_of(solution.mesh, j);
    }
    if (!(whole > 0.0) || !std::isfinite(whole)) return solution.mesh;
    std::vector<double> mesh{0.0};
    std::size_t j = 0;
    double before = 0.0;
    for (std::size_t k = 1; k < count; ++k) {
        const double wanted = whole * static_cast<double>(k) / static_cast<double>(count);
        while (j + 1 < count && before + density[j] * width_of(solution.mesh, j) < wanted) {
            before += density[j] * width_of(solution.mesh, j);
            ++j;
        }
        mesh.push_back(std::max(solution.mesh[j] + (wanted - before) / density[j], mesh.back()));
    }
    return mesh;
}

std::vector<double> halved(const std::vector<double>& mesh) {
    std::vector<double> result;
    for (std::size_t j = 0; j < mesh.size(); ++j) {
        result.push_back(mesh[j]);
        result.push_back(mesh[j] + 0.5 * width_of(mesh, j));
    }
    return result;
}

}  // namespace orbid::periodic
