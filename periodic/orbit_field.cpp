#include "periodic/orbit_field.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Balances the truncation h^2 f''' / 6 of a central difference against its rounding eps / h.
const double relative_step = std::cbrt(std::numeric_limits<double>::epsilon());

}  // namespace

OrbitField::OrbitField(const models::System& system, const VectorXd& theta, double phase, Index periods,
                       const VectorXd& scale)
    : system_(system),
      theta_(theta),
      phase_(phase),
      periods_(static_cast<double>(periods)),
      scale_(scale),
      autonomous_(system.kind() == models::Kind::autonomous) {
    if (!autonomous_) forced_duration_ = periods_ * system.period(theta, models::Clock::time);
}

double OrbitField::step_of(Index parameter) const {
    const auto& entry = system_.parameters()[static_cast<std::size_t>(parameter)];
    return relative_step * std::max(std::abs(theta_(parameter)), entry.typical_size > 0.0 ? entry.typical_size : 1.0);
}

bool OrbitField::one_sided(Index parameter) const {
    const auto domain = system_.parameters()[static_cast<std::size_t>(parameter)].domain;
    return !models::contains(domain, theta_(parameter) - step_of(parameter));
}

VectorXd OrbitField::moved(Index parameter, double steps) const {
    VectorXd theta = theta_;
    theta(parameter) += steps * step_of(parameter);
    return theta;
}

MatrixXd OrbitField::at(const MatrixXd& states, std::span<const double> shares, double time,
                        const VectorXd& theta) const {
    std::vector<double> phases(shares.size(), 0.0);
    if (autonomous_) return time * system_.rhs(states, phases, theta);
    for (std::size_t k = 0; k < shares.size(); ++k)
        phases[k] = phase_ + 2.0 * std::numbers::pi * std::fmod(periods_ * shares[k], 1.0);
    return periods_ * system_.period(theta, models::Clock::time) * system_.rhs(states, phases, theta);
}

MatrixXd OrbitField::value(const MatrixXd& states, std::span<const double> shares, double time) const {
    return at(states, shares, time, theta_);
}

Eigen::RowVectorXd OrbitField::ln_duration_slopes(std::span<const Index> free) const {
    Eigen::RowVectorXd slopes = Eigen::RowVectorXd::Zero(static_cast<Index>(free.size()));
    if (autonomous_) return slopes;
    for (Index k = 0; k < slopes.size(); ++k) {
        const Index parameter = free[static_cast<std::size_t>(k)];
        const double up = system_.period(moved(parameter, 1.0), models::Clock::time);
        const double down = one_sided(parameter) ? system_.period(theta_, models::Clock::time)
                                                 : system_.period(moved(parameter, -1.0), models::Clock::time);
        slopes(k) = std::log(up / down) / ((one_sided(parameter) ? 1.0 : 2.0) * step_of(parameter));
    }
    return slopes;
}

FieldValues OrbitField::values(const MatrixXd& states, std::span<const double> shares, double time,
                               std::span<const Index> free) const {
    const Index n = dimension();
    const Index m = states.cols();
    // All states with all their neighbours in one call: x, x + h e_1, x - h e_1, ...
    const Index group = 2 * n + 1;
    MatrixXd all(n, m * group);
    std::vector<double> all_shares;
    for (Index k = 0; k < m; ++k) {
        all.middleCols(k * group, group).colwise() = states.col(k);
        for (Index i = 0; i < n; ++i) {
            const double h = relative_step * scale_(i);
            all(i, k * group + 1 + 2 * i) += h;
            all(i, k * group + 2 + 2 * i) -= h;
        }
        all_shares.insert(all_shares.end(), static_cast<std::size_t>(group), shares[static_cast<std::size_t>(k)]);
    }
    const MatrixXd f = at(all, all_shares, time, theta_);
    FieldValues result;
    result.value.resize(n, m);
    result.by_state.resize(n, m * n);
    for (Index k = 0; k < m; ++k) {
        result.value.col(k) = f.col(k * group);
        for (Index i = 0; i < n; ++i) {
            const Index up = k * group + 1 + 2 * i;
            result.by_state.col(k * n + i) = (f.col(up) - f.col(up + 1)) / (all(i, up) - all(i, up + 1));
        }
    }
    const auto count = static_cast<Index>(free.size());
    result.by_parameters.resize(n, m * count);
    for (Index p = 0; p < count; ++p) {
        const Index parameter = free[static_cast<std::size_t>(p)];
        const double h = step_of(parameter);
        MatrixXd slope;
        if (one_sided(parameter)) {
            slope = (4.0 * at(states, shares, time, moved(parameter, 1.0)) - 3.0 * result.value -
                     at(states, shares, time, moved(parameter, 2.0))) /
                    (2.0 * h);
        } else {
            slope =
                (at(states, shares, time, moved(parameter, 1.0)) - at(states, shares, time, moved(parameter, -1.0))) /
                (2.0 * h);
        }
        for (Index k = 0; k < m; ++k)
            result.by_parameters.col(k * count + p) = slope.col(k);
    }
    return result;
}

}  // namespace orbid::periodic
