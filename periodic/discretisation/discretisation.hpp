#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

namespace orbid::periodic {

/// The image of one step and its derivatives; d: length of z, f: number of free parameters.
struct StepImage {
    bool simulated = false;         ///< everything else is meaningful only if so
    bool sticking = false;          ///< the step contains sticking
    Eigen::VectorXd value;          ///< shape (d)
    Eigen::MatrixXd by_state;       ///< shape (d, d)
    Eigen::VectorXd by_ln_time;     ///< shape (d): T d value / dT; empty where T is known
    Eigen::MatrixXd by_parameters;  ///< shape (d, f)
};

/// A periodic boundary value problem in discrete time: N one-step maps on a circle,
///
///     z_{j+1} = F_j(z_j; T, theta),   j mod N.
///
/// Shooting: F_j is the flow over a segment and z the state. Finite differences and collocation have the same form:
/// their further unknowns are solved for within the step. One Newton method, one linear system and one result serve
/// them all. Implementations are const and thread-safe.
class Discretisation {
public:
    virtual ~Discretisation() = default;

    [[nodiscard]] virtual Eigen::Index steps() const = 0;
    /// Length of z: a multiple of the model's dimension n; entries i, i + n, ... belong to coordinate i.
    [[nodiscard]] virtual Eigen::Index dimension() const = 0;
    /// The period T is an unknown (autonomous flows).
    [[nodiscard]] virtual bool unknown_time() const = 0;
    /// F_j(z).
    [[nodiscard]] virtual StepImage advance(Eigen::Index j, const Eigen::VectorXd& z, double time,
                                            std::span<const Eigen::Index> free) const = 0;
    /// The model's state at z_j, shape (n); by_state has shape (n, d).
    [[nodiscard]] virtual StepImage state(Eigen::Index j, const Eigen::VectorXd& z, double time,
                                          std::span<const Eigen::Index> free) const;
    /// Where z_j lies on the orbit: time since z_0 / T, in [0, 1).
    [[nodiscard]] virtual double share(Eigen::Index j) const = 0;
    /// n x n factors of the monodromy matrix, the first one applied first; `jacobians` are those of advance(). One per
    /// step, or several where steps are split to keep the digits of the small multipliers.
    [[nodiscard]] virtual std::vector<Eigen::MatrixXd> propagators(const std::vector<Eigen::MatrixXd>& jacobians,
                                                                   const Eigen::MatrixXd& nodes, double time) const;

protected:
    Discretisation() = default;
    Discretisation(const Discretisation&) = default;
    Discretisation& operator=(const Discretisation&) = default;
};

}  // namespace orbid::periodic
