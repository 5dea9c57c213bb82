#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "tests/estimator/function_residual.hpp"
#include "tests/estimator/small_dual.hpp"

namespace orbid::tests {

/// A sum of squares in a form that any solver can be given.
struct LeastSquares {
    /// Residuals e (length `residuals`) and, unless null, de/db row by row (residuals x parameters).
    using Function = std::function<void(const double* b, double* e, double* jacobian)>;
    int parameters = 0;
    int residuals = 0;
    Function function;
};

/// Function from `write(b, put)`, which calls put(i, e_i) for every residual, for numbers and duals alike.
template <int Parameters, class Write>
LeastSquares::Function with_derivatives(Write write) {
    return [write](const double* b, double* e, double* jacobian) {
        if (jacobian == nullptr) {
            write(b, [e](std::size_t i, double value) { e[i] = value; });
            return;
        }
        std::array<SmallDual<Parameters>, Parameters> dual;
        for (int i = 0; i < Parameters; ++i)
            dual[static_cast<std::size_t>(i)] = SmallDual<Parameters>::variable(b[i], i);
        write(dual.data(), [e, jacobian](std::size_t i, const SmallDual<Parameters>& value) {
            e[i] = value.v;
            for (std::size_t k = 0; k < Parameters; ++k)
                jacobian[i * Parameters + k] = value.d[k];
        });
    };
}

/// The problem as a residual of the estimator: one group "y", one block.
inline FunctionResidual residual_of(const LeastSquares& problem, const estimator::Group& errors) {
    FunctionResidual residual;
    residual.add_group(errors);
    residual.add_block(layout("data", problem.residuals),
                       [problem](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool derivatives) {
                           using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
                           estimator::BlockValue value;
                           value.e.resize(problem.residuals);
                           if (!derivatives) {
                               problem.function(theta.data(), value.e.data(), nullptr);
                               return value;
                           }
                           RowMajor jacobian(problem.residuals, problem.parameters);
                           problem.function(theta.data(), value.e.data(), jacobian.data());
                           value.e_theta = jacobian;
                           value.e_z.resize(problem.residuals, 0);
                           return value;
                       });
    return residual;
}

}  // namespace orbid::tests
