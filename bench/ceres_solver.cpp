#include "bench/ceres_solver.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <ceres/ceres.h>

namespace orbid::bench {

namespace {

class Part : public ceres::CostFunction {
public:
    explicit Part(const tests::LeastSquares& problem) : problem_(problem) {
        set_num_residuals(problem.residuals);
        mutable_parameter_block_sizes()->push_back(problem.parameters);
    }
    bool Evaluate(double const* const* x, double* e, double** jacobians) const override {
        double* jacobian = jacobians != nullptr ? jacobians[0] : nullptr;
        if (jacobian == nullptr)
            problem_.values(x[0], e);
        else
            problem_.row_by_row(x[0], e, jacobian);
        // Ceres rejects such a point in any case, and prints a page about it.
        const auto finite = [](double a) { return std::isfinite(a); };
        const std::ptrdiff_t entries =
            jacobian == nullptr ? 0 : std::ptrdiff_t{problem_.residuals} * problem_.parameters;
        return std::all_of(e, e + problem_.residuals, finite) && std::all_of(jacobian, jacobian + entries, finite);
    }

private:
    const tests::LeastSquares& problem_;
};

}  // namespace

Solution solve_with_ceres(const std::vector<tests::LeastSquares>& parts, const Task& task, int threads) {
    const auto begin = std::chrono::steady_clock::now();
    Solution solution;
    solution.x = task.start;
    ceres::Problem problem;
    for (const tests::LeastSquares& part : parts)
        problem.AddResidualBlock(new Part(part), nullptr, solution.x.data());
    for (std::size_t i = 0; i < task.lower.size(); ++i) {
        problem.SetParameterLowerBound(solution.x.data(), static_cast<int>(i), task.lower[i]);
        problem.SetParameterUpperBound(solution.x.data(), static_cast<int>(i), task.upper[i]);
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.function_tolerance = 1e-16;
    options.gradient_tolerance = 1e-16;
    options.parameter_tolerance = 1e-14;
    options.max_num_iterations = 5000;
    options.num_threads = threads;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    solution.converged = summary.termination_type == ceres::CONVERGENCE;
    solution.iterations = static_cast<int>(summary.iterations.size());
    solution.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return solution;
}

}  // namespace orbid::bench
