#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// The arguments of a flow, held by reference.
struct FlowArguments {
    const System& system;
    const Eigen::VectorXd& x0;
    double phase;
    std::span<const double> durations;
    const Eigen::VectorXd& theta;
    std::span<const Eigen::Index> free;
    Clock clock;
    const FlowOptions& options;
};

/// Difference quotient with its estimated error.
struct Quotient {
    double value;
    double error;
};

/// Difference quotients of a flow in one direction, of second order, from large to small steps.
class DifferenceQuotients {
public:
    /// A quotient with step h, shape (n, m), nan where it is unusable. Its integration error is `noise` / h times the
    /// error of the states. Steps come in the order 1, 1/4, 1/16 ...
    void add(double h, double noise, std::optional<Eigen::MatrixXd> quotient);

    /// The extrapolated entry with the smallest estimated error: its distance from the quotient it started from and
    /// from the extrapolation before. Three steps have to agree, as two do by chance. None where fewer than three steps
    /// are usable.
    /// @param state_error  shape (n, m): error of the states of a flow
    [[nodiscard]] std::optional<Quotient> best(Eigen::Index row, Eigen::Index column,
                                               const Eigen::MatrixXd& state_error) const;

private:
    struct Step {
        double h;
        double noise;
        std::optional<Eigen::MatrixXd> quotient;
    };
    std::vector<Step> steps_;
};

/// Central quotients of the flow `base`, and those to either side, with seven steps from 1 % of the size of the
/// direction:
///
///     (x(h) - x(-h)) / (2 h),     +-(16 x(+-h) - x(+-4 h) - 15 x(0)) / (12 h)
///
/// Unusable are flows at parameters outside their domain, with another status than ok, with another number of switching
/// events than `base`, or a tenth of its size away from it.
///
/// @param direction  0 to n - 1: coordinate of the start; then the parameters `free`
/// @param sizes      of all directions, > 0: what counts as a change of 1
[[nodiscard]] std::array<DifferenceQuotients, 3> difference_quotients(const FlowArguments& arguments,
                                                                      const FlowResult& base, Eigen::Index direction,
                                                                      const Eigen::VectorXd& sizes);

}  // namespace orbid::models

#pragma GCC visibility pop
