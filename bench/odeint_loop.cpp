#include "bench/odeint_loop.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <boost/numeric/odeint.hpp>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "models/catalogue/driven_pendulum.hpp"
#include "models/catalogue/parametric_pendulum.hpp"
#include "tests/models/trajectories/extended_flow.hpp"

namespace orbid::bench {

namespace {

namespace odeint = boost::numeric::odeint;
using models::DrivenPendulum;
using models::parameter_count_of;
using models::Values;
using Crank = models::PendulumOn<models::Support::crank>;

template <class M>
Values<double, parameter_count_of<M>> parameters_of(double k1) {
    Values<double, parameter_count_of<M>> p;
    for (std::size_t i = 0; i < p.size(); ++i)
        p[i] = M::parameters[i].default_value;
    if constexpr (models::SwitchingModel<M>) p[2] = k1;
    return p;
}

struct Driven {
    double gamma, amplitude, omega;
    void operator()(const Point& x, Point& f, double tau) const {
        f[0] = x[1] / omega;
        f[1] = (amplitude * std::cos(tau) - gamma * x[1] - std::sin(x[0])) / omega;
    }
};

struct Parametric {  // constants reduced beforehand
    double k1, k2, k3, w0, aw, e, omega;
    void operator()(const Point& x, Point& f, double tau) const {
        const double s = std::sin(tau), c = std::cos(tau), root = 1.0 - e * e * s * s;
        const double p = w0 - aw * (c + e * (1.0 - 2.0 * s * s + e * e * s * s * s * s) / (root * std::sqrt(root)));
        f[0] = x[1] / omega;
        f[1] = (-std::copysign(k1, x[1]) - x[1] * (k2 + k3 * std::abs(x[1])) - p * std::sin(x[0])) / omega;
    }
};

template <class Stepper, class F>
std::vector<Point> images(const F& f, double tolerance, const std::vector<Point>& points, std::size_t& abandoned,
                          std::size_t most_steps) {
    constexpr double turn = 2.0 * std::numbers::pi;
    std::vector<Point> result;
    result.reserve(points.size());
    for (Point x : points) {
        // As odeint::integrate_adaptive does it, but for the limit; a new stepper, as dopri5 keeps the last slope.
        auto stepper = odeint::make_controlled(tolerance, tolerance, Stepper());
        double tau = 0.0, step = turn / 40.0;
        std::size_t steps = 0;
        for (; tau < turn && steps < most_steps; ++steps) {
            if (tau + step > turn) step = turn - tau;
            stepper.try_step(f, x, tau, step);
        }
        if (tau < turn) ++abandoned;
        result.push_back(x);
    }
    return result;
}

template <class F>
std::vector<Point> images(const F& f, Method method, double tolerance, const std::vector<Point>& points,
                          std::size_t& abandoned, std::size_t most_steps) {
    return method == Method::rkf78
               ? images<odeint::runge_kutta_fehlberg78<Point>>(f, tolerance, points, abandoned, most_steps)
               : images<odeint::runge_kutta_dopri5<Point>>(f, tolerance, points, abandoned, most_steps);
}

template <class M>
std::vector<std::array<long double, 2>> exact(double k1, const std::vector<Point>& points) {
    const models::ExtendedFlow<M> flow(parameters_of<M>(k1));
    std::vector<std::array<long double, 2>> result(points.size());
    oneapi::tbb::parallel_for(std::size_t{0}, points.size(),
                              [&](std::size_t i) { result[i] = flow.period(points[i]); });
    return result;
}

}  // namespace

std::vector<Point> images_by_odeint(Pendulum pendulum, double k1, Method method, double tolerance,
                                    const std::vector<Point>& points, std::size_t& abandoned, std::size_t most_steps) {
    if (pendulum == Pendulum::driven) {
        const auto [gamma, amplitude, omega] = parameters_of<DrivenPendulum>(0.0);
        return images(Driven{gamma, amplitude, omega}, method, tolerance, points, abandoned, most_steps);
    }
    const auto p = parameters_of<Crank>(k1);
    const auto c = Crank::reduced(p);
    return images(Parametric{c[0], c[1], c[2], c[3], c[4], c[5], p[Crank::forcing_frequency]}, method, tolerance,
                  points, abandoned, most_steps);
}

std::vector<std::array<long double, 2>> exact_images(Pendulum pendulum, double k1, const std::vector<Point>& points) {
    return pendulum == Pendulum::driven ? exact<DrivenPendulum>(k1, points) : exact<Crank>(k1, points);
}

}  // namespace orbid::bench
