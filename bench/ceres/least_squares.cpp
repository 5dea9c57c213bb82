#include <ceres/ceres.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "bench/ceres/peer.h"

namespace {

class Part : public ceres::CostFunction {
public:
    Part(const peer_least_squares_task& task, int part) : task_(task), part_(part) {
        set_num_residuals(task.residuals[part]);
        mutable_parameter_block_sizes()->push_back(task.parameters);
    }
    bool Evaluate(double const* const* x, double* e, double** jacobians) const override {
        double* const jacobian = jacobians != nullptr ? jacobians[0] : nullptr;
        task_.function(task_.problem, part_, x[0], e, jacobian);
        // Ceres rejects such a point in any case, and prints a page about it.
        const auto finite = [](double a) { return std::isfinite(a); };
        const std::ptrdiff_t entries = jacobian == nullptr ? 0 : std::ptrdiff_t{num_residuals()} * task_.parameters;
        return std::all_of(e, e + num_residuals(), finite) && std::all_of(jacobian, jacobian + entries, finite);
    }

private:
    const peer_least_squares_task& task_;
    int part_;
};

}  // namespace

peer_least_squares_result peer_solve_least_squares(const peer_least_squares_task* task, double* x) {
    const auto begin = std::chrono::steady_clock::now();
    ceres::Problem problem;
    for (int part = 0; part < task->parts; ++part)
        problem.AddResidualBlock(new Part(*task, part), nullptr, x);
    for (int i = 0; task->lower != nullptr && i < task->parameters; ++i) {
        problem.SetParameterLowerBound(x, i, task->lower[i]);
        problem.SetParameterUpperBound(x, i, task->upper[i]);
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.function_tolerance = 1e-16;
    options.gradient_tolerance = 1e-16;
    options.parameter_tolerance = 1e-14;
    options.max_num_iterations = 5000;
    options.num_threads = task->threads;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return {summary.termination_type == ceres::CONVERGENCE ? 1 : 0, static_cast<int>(summary.iterations.size()),
            std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count()};
}
