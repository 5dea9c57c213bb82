#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/interface/small_dual.hpp"

namespace orbid::tests {

/// A sum of squares in a form that any solver can be given.
struct LeastSquares {
    /// Residuals e (length `residuals`) and, unless null, de_i/db_k at jacobian[i * row + k * column]: every solver is
    /// served in its own order.
    using Function =
        std::function<void(const double* b, double* e, double* jacobian, std::size_t row, std::size_t column)>;
    int parameters = 0;
    int residuals = 0;
    Function function;

    void values(const double* b, double* e) const { function(b, e, nullptr, 0, 0); }
    void row_by_row(const double* b, double* e, double* jacobian) const {
        function(b, e, jacobian, static_cast<std::size_t>(parameters), 1);
    }
    void column_by_column(const double* b, double* e, double* jacobian) const {
        function(b, e, jacobian, 1, static_cast<std::size_t>(residuals));
    }
};

/// Function from `write(b, put)`, which calls put(i, e_i) for every residual, for numbers and duals alike.
template <int Parameters, class Write>
LeastSquares::Function with_derivatives(Write write) {
    return [write](const double* b, double* e, double* jacobian, std::size_t row, std::size_t column) {
        if (jacobian == nullptr) {
            write(b, [e](std::size_t i, double value) { e[i] = value; });
            return;
        }
        std::array<SmallDual<Parameters>, Parameters> dual;
        for (int i = 0; i < Parameters; ++i)
            dual[static_cast<std::size_t>(i)] = SmallDual<Parameters>::variable(b[i], i);
        write(dual.data(), [=](std::size_t i, const SmallDual<Parameters>& value) {
            e[i] = value.v;
            for (std::size_t k = 0; k < Parameters; ++k)
                jacobian[i * row + k * column] = value.d[k];
        });
    };
}

/// The problem as a residual of the estimator: one group "y", one block.
inline FunctionResidual residual_of(const LeastSquares& problem, const estimator::Group& errors) {
    FunctionResidual residual;
    residual.add_group(errors);
    residual.add_block(layout("data", problem.residuals),
                       [problem](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool derivatives) {
                           estimator::BlockValue value;
                           value.e.resize(problem.residuals);
                           if (!derivatives) {
                               problem.values(theta.data(), value.e.data());
                               return value;
                           }
                           value.e_theta.resize(problem.residuals, problem.parameters);
                           problem.column_by_column(theta.data(), value.e.data(), value.e_theta.data());
                           value.e_z.resize(problem.residuals, 0);
                           return value;
                       });
    return residual;
}

}  // namespace orbid::tests
