#include "models/system/difference_quotient.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace orbid::models {

namespace {

/// Steps 1e-2 4^-i of the size of a direction: 1e-2 to 2.4e-6. Beyond, integration errors of 1e-12 are all that is
/// seen.
constexpr int step_count = 7;
constexpr double first_step = 1e-2;
/// A factor of 4 lets one-sided quotients share the points of neighbouring steps.
constexpr double step_ratio = 4.0;
/// A neighbour further away than this part of the size of a coordinate has left the range where differences converge.
constexpr double far_away = 0.1;

/// States at all durations, shape (n, m), with the direction changed by `by`; nan from where they are far away.
std::optional<Eigen::MatrixXd> neighbour(const FlowArguments& arguments, const FlowResult& base,
                                         const Eigen::VectorXd& sizes, Eigen::Index direction, double by) {
    const auto& [system, x0, phase, durations, theta, free, clock, options] = arguments;
    Eigen::VectorXd x = x0, p = theta;
    const Eigen::Index n = system.dimension();
    if (direction < n) {
        x[direction] += by;
    } else {
        const Eigen::Index parameter = free[static_cast<std::size_t>(direction - n)];
        p[parameter] += by;
        if (!contains(system.parameters()[static_cast<std::size_t>(parameter)].domain, p[parameter]))
            return std::nullopt;
    }
    FlowResult flow = system.flow(x, phase, durations, p, clock, options);
    if (flow.status != FlowStatus::ok || flow.crossings != base.crossings || flow.stickings != base.stickings ||
        !flow.states.allFinite())
        return std::nullopt;
    for (Eigen::Index k = 0; k < flow.states.cols(); ++k) {
        const Eigen::VectorXd change = flow.states.col(k) - base.states.col(k);
        if (change.cwiseQuotient(sizes.head(n)).lpNorm<Eigen::Infinity>() <= far_away) continue;
        flow.states.rightCols(flow.states.cols() - k).setConstant(std::numeric_limits<double>::quiet_NaN());
        break;
    }
    return std::move(flow.states);
}

/// Without the term of second order.
double extrapolated(double coarse, double fine) {
    return fine + (fine - coarse) / (step_ratio * step_ratio - 1.0);
}

}  // namespace

void DifferenceQuotients::add(double h, double noise, std::optional<Eigen::MatrixXd> quotient) {
    steps_.push_back({h, noise, std::move(quotient)});
}

std::optional<Quotient> DifferenceQuotients::best(Eigen::Index row, Eigen::Index column,
                                                  const Eigen::MatrixXd& state_error) const {
    std::optional<Quotient> best;
    for (std::size_t i = 2; i < steps_.size(); ++i) {
        if (!steps_[i - 2].quotient || !steps_[i - 1].quotient || !steps_[i].quotient) continue;
        const double coarse = (*steps_[i - 2].quotient)(row, column);
        const double middle = (*steps_[i - 1].quotient)(row, column);
        const double fine = (*steps_[i].quotient)(row, column);
        const double before = extrapolated(coarse, middle), value = extrapolated(middle, fine);
        const double error = std::max(std::abs(value - fine), std::abs(value - before)) +
                             steps_[i].noise * state_error(row, column) / steps_[i].h;
        if (!std::isfinite(error) || std::isnan(before)) continue;
        if (!best || error < best->error) best = Quotient{value, error};
    }
    return best;
}

std::array<DifferenceQuotients, 3> difference_quotients(const FlowArguments& arguments, const FlowResult& base,
                                                        Eigen::Index direction, const Eigen::VectorXd& sizes) {
    std::array<DifferenceQuotients, 3> quotients;
    std::array<std::optional<Eigen::MatrixXd>, 2> before;  // at +-4 h
    double h = first_step * sizes[direction];
    for (int i = 0; i < step_count; ++i, h /= step_ratio) {
        std::array<std::optional<Eigen::MatrixXd>, 2> at{neighbour(arguments, base, sizes, direction, h),
                                                         neighbour(arguments, base, sizes, direction, -h)};
        std::optional<Eigen::MatrixXd> central;
        if (at[0] && at[1]) central = (*at[0] - *at[1]) / (2.0 * h);
        quotients[0].add(h, 1.0, std::move(central));
        for (std::size_t side = 0; side < 2; ++side) {
            std::optional<Eigen::MatrixXd> one_sided;
            if (at[side] && before[side])
                one_sided = (16.0 * *at[side] - *before[side] - 15.0 * base.states) / ((side == 0 ? 12.0 : -12.0) * h);
            quotients[side + 1].add(h, 32.0 / 12.0, std::move(one_sided));
        }
        before = std::move(at);
    }
    return quotients;
}

}  // namespace orbid::models
