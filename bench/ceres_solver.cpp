#include "bench/ceres_solver.hpp"

#include "bench/ceres/peer.h"

namespace orbid::bench {

namespace {

void evaluate(void* problem, int part, const double* x, double* e, double* jacobian) {
    const auto& parts = *static_cast<const std::vector<tests::LeastSquares>*>(problem);
    const tests::LeastSquares& sum = parts[static_cast<std::size_t>(part)];
    jacobian == nullptr ? sum.values(x, e) : sum.row_by_row(x, e, jacobian);
}

}  // namespace

Solution solve_with_ceres(const std::vector<tests::LeastSquares>& parts, const Task& task, int threads) {
    std::vector<int> residuals;
    for (const tests::LeastSquares& part : parts)
        residuals.push_back(part.residuals);
    auto problem = parts;
    peer_least_squares_task given{};
    given.parameters = static_cast<int>(task.start.size());
    given.parts = static_cast<int>(parts.size());
    given.residuals = residuals.data();
    given.function = evaluate;
    given.problem = &problem;
    given.lower = task.lower.empty() ? nullptr : task.lower.data();
    given.upper = task.upper.empty() ? nullptr : task.upper.data();
    given.threads = threads;
    Solution solution;
    solution.x = task.start;
    const peer_least_squares_result found = peer_solve_least_squares(&given, solution.x.data());
    solution.converged = found.converged != 0;
    solution.iterations = found.iterations;
    solution.seconds = found.seconds;
    return solution;
}

}  // namespace orbid::bench
