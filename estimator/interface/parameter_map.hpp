#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// The source of one parameter of a full vector theta.
struct ParameterSource {
    Eigen::Index reduced = -1;  ///< index into the reduced vector; -1: pinned
    double value = 0.0;         ///< pinned: its value; else the factor on the reduced parameter
};

/// How a full vector theta follows from a reduced one: theta_i = factor_i * reduced[k_i], or a known constant.
///
/// Several full parameters may follow one reduced parameter (ties). Linear, so that derivatives are exact.
class ParameterMap {
public:
    /// @throws std::invalid_argument on an index outside [-1, reduced), a pinned value that is not finite, a factor
    ///         that is 0 or not finite.
    ParameterMap(std::vector<ParameterSource> sources, Eigen::Index reduced);

    /// Every parameter free and its own.
    [[nodiscard]] static ParameterMap identity(Eigen::Index count);

    /// `count` parameters of which some are pinned, {index, value}; the others keep their order.
    /// @throws std::invalid_argument on an index outside [0, count) or given twice, or a value that is not finite.
    [[nodiscard]] static ParameterMap pinned(Eigen::Index count,
                                             const std::vector<std::pair<Eigen::Index, double>>& pins);

    [[nodiscard]] Eigen::Index full_size() const { return static_cast<Eigen::Index>(sources_.size()); }
    [[nodiscard]] Eigen::Index reduced_size() const { return reduced_; }
    [[nodiscard]] const std::vector<ParameterSource>& sources() const { return sources_; }

    /// theta from the reduced vector, shape (full).
    [[nodiscard]] Eigen::VectorXd expand(const Eigen::VectorXd& reduced) const;

    /// d / d reduced from d / d theta: columns of an (n, full) matrix summed with their factors, shape (n, reduced).
    [[nodiscard]] Eigen::MatrixXd reduce_columns(const Eigen::MatrixXd& columns) const;

    /// d theta / d reduced, shape (full, reduced).
    [[nodiscard]] Eigen::MatrixXd jacobian() const;

private:
    std::vector<ParameterSource> sources_;
    Eigen::Index reduced_;
};

}  // namespace orbid::estimator

#pragma GCC visibility pop
