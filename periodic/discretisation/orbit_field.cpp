#include "periodic/discretisation/orbit_field.hpp"

#include <cmath>
#include <cstddef>
#include <numbers>

namespace orbid::periodic {

OrbitField::OrbitField(const models::System& system, const VectorXd& theta, double phase, Index periods)
    : system_(system),
      theta_(theta),
      phase_(phase),
      periods_(static_cast<double>(periods)),
      autonomous_(system.kind() == models::Kind::autonomous) {
    if (!autonomous_) forced_duration_ = periods_ * system.period(theta, models::Clock::time);
}

std::vector<double> OrbitField::phases_at(std::span<const double> shares) const {
    std::vector<double> phases(shares.size(), 0.0);
    if (autonomous_) return phases;
    for (std::size_t k = 0; k < shares.size(); ++k)
        phases[k] = phase_ + 2.0 * std::numbers::pi * std::fmod(periods_ * shares[k], 1.0);
    return phases;
}

MatrixXd OrbitField::value(const MatrixXd& states, std::span<const double> shares, double time) const {
    return duration(time) * system_.rhs(states, phases_at(shares), theta_);
}

Eigen::RowVectorXd OrbitField::ln_duration_slopes(std::span<const Index> free) const {
    Eigen::RowVectorXd slopes = Eigen::RowVectorXd::Zero(static_cast<Index>(free.size()));
    const auto frequency = system_.forcing_frequency();
    for (Index k = 0; frequency && k < slopes.size(); ++k)
        if (free[static_cast<std::size_t>(k)] == *frequency) slopes(k) = -1.0 / theta_(*frequency);
    return slopes;
}

FieldValues OrbitField::values(const MatrixXd& states, std::span<const double> shares, double time,
                               std::span<const Index> free) const {
    const Index n = dimension(), m = states.cols(), count = static_cast<Index>(free.size());
    const double duration_now = duration(time);
    const std::vector<double> phases = phases_at(shares);
    const Eigen::RowVectorXd slopes = ln_duration_slopes(free);
    FieldValues result;
    result.value = duration_now * system_.rhs(states, phases, theta_);
    const MatrixXd derivatives = duration_now * system_.rhs_derivatives(states, phases, theta_, free);
    result.by_state.resize(n, m * n);
    result.by_parameters.resize(n, m * count);
    for (Index k = 0; k < m; ++k) {
        result.by_state.middleCols(k * n, n) = derivatives.middleCols(k * (n + count), n);
        result.by_parameters.middleCols(k * count, count) =
            derivatives.middleCols(k * (n + count) + n, count) + result.value.col(k) * slopes;
    }
    return result;
}

}  // namespace orbid::periodic
