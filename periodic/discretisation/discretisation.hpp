#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// The image of one step and its derivatives; d: length of z, f: number of free parameters.
struct StepImage {
    bool simulated = false;  ///< everything else is meaningful only if so
    bool sticking = false;   ///< the step contains sticking
    VectorXd value;          ///< shape (d)
    MatrixXd by_state;       ///< shape (d, d)
    VectorXd by_ln_time;     ///< shape (d): T d value / dT; empty where T is known
    MatrixXd by_parameters;  ///< shape (d, f)
    /// by_state of the pieces that the step was split into, the first one applied first; empty: it was not.
    std::vector<MatrixXd> pieces;
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

    [[nodiscard]] Index steps() const { return static_cast<Index>(shares_.size()); }
    /// Length of z: a multiple of the model's dimension n; entries i, i + n, ... belong to coordinate i.
    [[nodiscard]] Index dimension() const { return dimension_; }
    /// The period T is an unknown (autonomous flows).
    [[nodiscard]] bool unknown_time() const { return unknown_time_; }
    /// Where each z_j lies on the orbit: time since z_0 / T, ascending in [0, 1).
    [[nodiscard]] const std::vector<double>& shares() const { return shares_; }
    [[nodiscard]] double share(Index j) const { return shares_[static_cast<std::size_t>(j)]; }
    /// F_j(z).
    [[nodiscard]] virtual StepImage advance(Index j, const VectorXd& z, double time,
                                            std::span<const Index> free) const = 0;
    /// F_j(z_j) of all steps, one after the other; evaluated in parallel.
    /// @param nodes   shape (d, N).
    /// @param pieces  into which each step is split, as pieces() says; empty: none is.
    [[nodiscard]] virtual std::vector<StepImage> advance_all(const MatrixXd& nodes, double time,
                                                             std::span<const Index> free,
                                                             std::span<const int> pieces) const;
    /// Into how many pieces steps with such Jacobians are split, so that small multipliers keep their digits; empty:
    /// one each.
    [[nodiscard]] virtual std::vector<int> pieces(const std::vector<MatrixXd>& /*jacobians*/) const { return {}; }
    /// The model's state at z_j, shape (n); by_state has shape (n, d).
    [[nodiscard]] virtual StepImage state(Index j, const VectorXd& z, double time, std::span<const Index> free) const;
    /// n x n factors of the monodromy matrix, the first one applied first, from those of a ClosingError.
    [[nodiscard]] virtual std::vector<MatrixXd> propagators(const std::vector<MatrixXd>& factors) const {
        return factors;
    }

protected:
    Discretisation(std::vector<double> shares, Index dimension, bool unknown_time)
        : shares_(std::move(shares)), dimension_(dimension), unknown_time_(unknown_time) {}
    Discretisation(const Discretisation&) = default;
    Discretisation& operator=(const Discretisation&) = default;

private:
    std::vector<double> shares_;
    Index dimension_;
    bool unknown_time_;
};

/// Shares of so many steps of equal length.
[[nodiscard]] std::vector<double> equidistant(Index steps);

}  // namespace orbid::periodic
