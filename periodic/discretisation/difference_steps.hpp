#pragma once

#include <vector>

#include "periodic/discretisation/discretisation.hpp"
#include "periodic/discretisation/orbit_field.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Fey's scheme as one-step maps. z_k holds the positions q_k and, in the places of the velocities, the differences
/// w_k = (q_k - q_{k-1}) / h; with v = (w_k + w_{k+1}) / 2
///
///     w_{k+1} = w_k + h a(q_k, v, t_k),   q_{k+1} = q_k + h w_{k+1},
///
/// solved for v by Newton's method. The state at z_k is (q_k, v).
class SecondOrderSteps final : public Discretisation {
public:
    /// @param velocity  index of the velocity of each position, -1 for velocities (complete).
    SecondOrderSteps(const OrbitField& field, Index steps, const std::vector<Index>& velocity);

    [[nodiscard]] StepImage advance(Index j, const VectorXd& z, double time,
                                    std::span<const Index> free) const override;
    [[nodiscard]] StepImage state(Index j, const VectorXd& z, double time, std::span<const Index> free) const override;

private:
    const OrbitField& field_;
    std::vector<Index> positions_;
    std::vector<Index> velocities_;  ///< in the order of positions_
};

/// Centred differences of the first-order system as one-step maps on z_k = (x_{k-1}, x_k).
class CentredSteps final : public Discretisation {
public:
    CentredSteps(const OrbitField& field, Index steps)
        : Discretisation(equidistant(steps), 2 * field.dimension(), field.autonomous()), field_(field) {}

    [[nodiscard]] StepImage advance(Index j, const VectorXd& z, double time,
                                    std::span<const Index> free) const override;
    [[nodiscard]] StepImage state(Index j, const VectorXd& z, double time, std::span<const Index> free) const override;
    /// The two-step scheme has n multipliers too many, near those of -f. The n multipliers of the trapezoidal rule
    /// along the same orbit are as accurate, O(h^2).
    [[nodiscard]] std::vector<MatrixXd> propagators(const std::vector<MatrixXd>& jacobians) const override;

private:
    const OrbitField& field_;
};

}  // namespace orbid::periodic
