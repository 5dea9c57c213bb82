#pragma once

#include <ceres/jet.h>

#include <algorithm>
#include <array>
#include <boost/numeric/odeint.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>

/// What a user of Boost.Odeint and Ceres writes for flows with sensitivities: variational equations along the state,
/// their right hand side by ceres::Jet, error-controlled steps of runge_kutta_fehlberg78; velocity zeros of the
/// pendulum located by Newton's method on the length of a step, and the sensitivities multiplied there as they jump.
namespace orbid::bench {

struct LorenzEquations {
    static constexpr std::size_t n = 3, p = 3;
    static constexpr bool switching = false;
    template <class T>
    static void rhs(const T* x, const T* theta, double /*t*/, double /*side*/, T* f) {
        f[0] = theta[0] * (x[1] - x[0]);
        f[1] = x[0] * (theta[1] - x[2]) - x[1];
        f[2] = x[0] * x[1] - theta[2] * x[2];
    }
};

/// The parametric pendulum on its crank; theta = length and frictions l, k1, k2, k3. Mass, crank and gravity are known.
struct PendulumEquations {
    static constexpr std::size_t n = 2, p = 4;
    static constexpr bool switching = true;
    static constexpr double mass = 0.0858, gravity = 9.81, radius = 0.131, omega = 9.09, epsilon = 0.173;
    template <class T>
    static void rhs(const T* x, const T* theta, double t, double side, T* f) {
        using std::sin;
        const double s = std::sin(omega * t), c = std::cos(omega * t), root = 1.0 - epsilon * epsilon * s * s;
        const double motion =
            c + epsilon * (1.0 - 2.0 * s * s + epsilon * epsilon * s * s * s * s) / (root * std::sqrt(root));
        const T inertia = mass * theta[0] * theta[0];
        f[0] = x[1];
        f[1] = -(side * theta[1] + x[1] * (theta[2] + side * theta[3] * x[1])) / inertia -
               (gravity - radius * omega * omega * motion) / theta[0] * sin(x[0]);
    }
};

/// Flow of one of the above over ascending durations.
///
/// @tparam derivatives  with sensitivities to the start and theta
template <class E, bool derivatives>
class OdeintFlow {
public:
    static constexpr std::size_t n = E::n, d = derivatives ? E::n + E::p : 0, size = n * (1 + d);
    /// The state, then column by column its derivatives.
    using State = std::array<double, size>;

    OdeintFlow(const double* theta, double tolerance) : theta_(theta), tolerance_(tolerance) {}

    /// Writes the state at each duration. False: too many steps, or numbers that are not finite.
    bool run(const double* start, double t, std::span<const double> durations, State* states) {
        State x{};
        std::copy(start, start + n, x.begin());
        for (std::size_t j = 0; j < std::min(d, n); ++j)
            x[n + j * n + j] = 1.0;
        if constexpr (E::switching) {
            side_ = x[1] < 0.0 ? -1.0 : 1.0;
            held_ = x[1] == 0.0;
            for (std::size_t j = 0; held_ && j < d; ++j)
                x[n + j * n + 1] = 0.0;
        }
        const double begin = t;
        double step = 0.01;
        for (std::size_t k = 0; k < durations.size(); ++k) {
            if (!advance(x, t, begin + durations[k], step)) return false;
            states[k] = x;
        }
        return true;
    }

private:
    using Stepper = boost::numeric::odeint::runge_kutta_fehlberg78<State>;

    bool advance(State& x, double& t, double until, double& step) {
        namespace odeint = boost::numeric::odeint;
        auto controlled = odeint::make_controlled(tolerance_, tolerance_, Stepper());
        const auto f = [this](const State& y, State& slope, double at) { rhs(y, slope, at); };
        for (int tries = 0; t < until; ++tries) {
            if (tries == 20000 || !std::isfinite(x[0])) return false;
            if (held_) {
                wait(x, t, until);
                continue;
            }
            const State before = x;
            const double start = t;
            double ds = std::min(step, until - t);
            const bool cut = ds < step;
            if (controlled.try_step(f, x, t, ds) != odeint::success) {
                step = ds;
                continue;
            }
            step = cut ? std::max(step, ds) : ds;
            if (until - t < 1e-14) t = until;
            if constexpr (E::switching) {
                if (!(side_ * x[1] < 0.0)) continue;
                if (side_ * before[1] > 0.0) {
                    cross(x, t, before, start);
                } else {
                    // From the surface and back to it in one step.
                    step = 0.5 * (t - start);
                    x = before;
                    t = start;
                }
            }
        }
        return std::all_of(x.begin(), x.end(), [](double a) { return std::isfinite(a); });
    }

    /// Back to where the velocity is zero, and to the other side or into sticking.
    void cross(State& x, double& t, const State& before, double start) {
        double ds = (t - start) * std::abs(before[1]) / (std::abs(before[1]) + std::abs(x[1]));
        const auto f = [this](const State& y, State& slope, double at) { rhs(y, slope, at); };
        State slope;
        double low = 0.0, high = t - start;
        for (int newton = 0; newton < 60; ++newton) {
            x = before;
            Stepper().do_step(f, x, start, ds);
            rhs(x, slope, start + ds);
            (side_ * x[1] > 0.0 ? low : high) = ds;
            const double change = -x[1] / slope[1];
            if (std::abs(change) < 1e-13) break;
            ds += change;
            if (!(ds > low && ds < high)) ds = 0.5 * (low + high);
        }
        t = start + ds;
        x[1] = 0.0;
        rhs(x, slope, t);
        const double arriving = slope[1];
        side_ = -side_;
        rhs(x, slope, t);
        const double leaving = slope[1];
        held_ = !(arriving * leaving > 0.0);
        for (std::size_t j = 0; j < d; ++j)
            x[n + j * n + 1] *= held_ ? 0.0 : leaving / arriving;
    }

    /// Held by friction, until the forcing is stronger: looked at every millisecond, then bisected.
    void wait(const State& x, double& t, double until) {
        const auto released = [&](double at) {
            for (const double side : {1.0, -1.0}) {
                State slope;
                side_ = side;
                rhs(x, slope, at);
                if (side * slope[1] > 0.0) return true;
            }
            return false;
        };
        double free = std::min(t + 1e-3, until);
        if (!released(free)) {
            t = free;
            return;
        }
        for (int halving = 0; halving < 40; ++halving) {
            const double middle = 0.5 * (t + free);
            (released(middle) ? free : t) = middle;
        }
        t = free;
        held_ = !released(free);
    }

    void rhs(const State& y, State& slope, double t) const {
        if constexpr (!derivatives) {
            E::rhs(y.data(), theta_, t, side_, slope.data());
        } else {
            using Jet = ceres::Jet<double, static_cast<int>(n + E::p)>;
            std::array<Jet, n> x, f;
            std::array<Jet, E::p> theta;
            for (std::size_t i = 0; i < n; ++i)
                x[i] = Jet(y[i], static_cast<int>(i));
            for (std::size_t i = 0; i < E::p; ++i)
                theta[i] = Jet(theta_[i], static_cast<int>(n + i));
            E::rhs(x.data(), theta.data(), t, side_, f.data());
            for (std::size_t i = 0; i < n; ++i) {
                slope[i] = f[i].a;
                for (std::size_t j = 0; j < d; ++j) {
                    double sum = j < n ? 0.0 : f[i].v[static_cast<int>(j)];
                    for (std::size_t k = 0; k < n; ++k)
                        sum += f[i].v[static_cast<int>(k)] * y[n + j * n + k];
                    slope[n + j * n + i] = sum;
                }
            }
        }
    }

    const double* theta_;
    double tolerance_;
    double side_ = 1.0;
    bool held_ = false;
};

}  // namespace orbid::bench
