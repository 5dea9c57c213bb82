#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

#include "models/system.hpp"

namespace orbid::orbits {

/// A section point one period later.
struct SectionImage {
    Eigen::VectorXd state;    ///< shape (n), angles not wrapped
    Eigen::MatrixXd by_x;     ///< X of (M4), shape (n, n); empty without derivatives
    Eigen::MatrixXd by_free;  ///< Y of (M4), shape (n, f)
};

/// x -> Phi(x; theta) over one period of the forcing (or one step of a map).
class SectionMap {
public:
    /// @param phase  phase of the section [rad].
    /// @throws std::invalid_argument for an autonomous system or a phase that is not finite.
    SectionMap(const models::System& system, double phase, const models::FlowOptions& flow);

    /// Empty when the flow fails. @param theta full parameter vector; @param free parameters of the derivatives.
    [[nodiscard]] std::optional<SectionImage> operator()(const Eigen::VectorXd& x, const Eigen::VectorXd& theta,
                                                         std::span<const Eigen::Index> free, bool derivatives) const;

    [[nodiscard]] const models::System& system() const { return *system_; }
    [[nodiscard]] double phase() const { return phase_; }
    [[nodiscard]] const models::FlowOptions& flow() const { return flow_; }

private:
    const models::System* system_;
    double phase_;
    models::FlowOptions flow_;
};

/// a - b with angle coordinates wrapped to (-pi, pi]; shapes (n, m).
[[nodiscard]] Eigen::MatrixXd wrapped_difference(const models::System& system, const Eigen::MatrixXd& a,
                                                 const Eigen::MatrixXd& b);

/// Every parameter lies in its domain, so that a flow may be asked for.
[[nodiscard]] bool in_domain(const models::System& system, const Eigen::VectorXd& theta);

}  // namespace orbid::orbits
