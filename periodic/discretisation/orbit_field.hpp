#pragma once

#include <span>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Values and derivatives of the field at m states; columns belong to states.
struct FieldValues {
    MatrixXd value;          ///< shape (n, m)
    MatrixXd by_state;       ///< shape (n, m n): block k = d value_k / d state_k
    MatrixXd by_parameters;  ///< shape (n, m f): block k; empty unless asked for
};

/// The field of a flow over its whole orbit, with the share s of the orbit as the time:
///
///     dx/ds = G(x, s; T, theta) = T f(x, phase(s); theta),      s in [0, 1].
///
/// Forced models: T = p periods of the forcing. If the forcing frequency is free, G's derivatives include its effect on
/// T.
class OrbitField {
public:
    /// @param periods  of the forcing per orbit (forced models; ignored otherwise).
    OrbitField(const models::System& system, const VectorXd& theta, double phase, Index periods);

    [[nodiscard]] Index dimension() const { return system_.dimension(); }
    [[nodiscard]] bool autonomous() const { return autonomous_; }
    /// T [s]: `time` of autonomous flows, otherwise given by the parameters.
    [[nodiscard]] double duration(double time) const { return autonomous_ ? time : forced_duration_; }
    /// d ln T / d theta_k of the free parameters (forced models; zero otherwise). Shape (f).
    [[nodiscard]] Eigen::RowVectorXd ln_duration_slopes(std::span<const Index> free) const;
    /// G alone.
    [[nodiscard]] MatrixXd value(const MatrixXd& states, std::span<const double> shares, double time) const;
    [[nodiscard]] FieldValues values(const MatrixXd& states, std::span<const double> shares, double time,
                                     std::span<const Index> free) const;

private:
    [[nodiscard]] std::vector<double> phases_at(std::span<const double> shares) const;

    const models::System& system_;
    const VectorXd& theta_;
    double phase_;
    double periods_;
    bool autonomous_;
    double forced_duration_ = 0.0;
};

}  // namespace orbid::periodic
