#include "models/definition/input_signal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "models/definition/wrong_data.hpp"

namespace orbid::models {

InputSignal::InputSignal(std::span<const double> times, std::span<const double> values, std::size_t count,
                         Interpolation interpolation)
    : times_(times.begin(), times.end()), count_(count), interpolation_(interpolation) {
    if (count == 0) throw std::invalid_argument("input signal: number of inputs is 0, must be > 0");
    if (values.size() != count * times.size())
        throw std::invalid_argument(
            fmt::format("input signal: number of values is {}, must be {}", values.size(), count * times.size()));
    const auto require = [](bool rule, const std::string& message) {
        if (!rule) throw DataError("input signal: " + message);
    };
    require(times.size() >= 2, fmt::format("number of instants is {}, must be >= 2", times.size()));
    for (std::size_t k = 0; k < times.size(); ++k) {
        require(std::isfinite(times[k]), fmt::format("time {} is {}, must be a finite number", k, times[k]));
        require(k == 0 || times[k] > times[k - 1],
                fmt::format("time {} is {} s, must be > {} s: times ascend", k, times[k], k == 0 ? 0.0 : times[k - 1]));
        for (std::size_t i = 0; i < count; ++i)
            require(std::isfinite(values[k * count + i]),
                    fmt::format("value {} of input {} is {}, must be a finite number", k, i, values[k * count + i]));
    }
    const std::size_t pieces = times.size() - 1;
    coefficients_.assign(pieces * count * 4, 0.0);
    std::vector<double> second(times.size());  // u'' at the instants
    std::vector<double> pivot(times.size());
    for (std::size_t i = 0; i < count; ++i) {
        const auto u = [&](std::size_t k) { return values[k * count + i]; };
        const auto h = [&](std::size_t k) { return times[k + 1] - times[k]; };
        std::fill(second.begin(), second.end(), 0.0);
        if (interpolation == Interpolation::cubic) {
            // Continuity of u' at the inner instants: a tridiagonal system for u'', eliminated and substituted back.
            for (std::size_t k = 1; k < pieces; ++k) {
                pivot[k] = 2.0 * (h(k - 1) + h(k));
                second[k] = 6.0 * ((u(k + 1) - u(k)) / h(k) - (u(k) - u(k - 1)) / h(k - 1));
                if (k > 1) {
                    const double factor = h(k - 1) / pivot[k - 1];
                    pivot[k] -= factor * h(k - 1);
                    second[k] -= factor * second[k - 1];
                }
            }
            for (std::size_t k = pieces; k-- > 1;)
                second[k] = (second[k] - h(k) * second[k + 1]) / pivot[k];
        }
        for (std::size_t k = 0; k < pieces; ++k) {
            double* c = coefficients_.data() + (k * count + i) * 4;
            c[0] = u(k);
            c[1] = (u(k + 1) - u(k)) / h(k) - h(k) * (2.0 * second[k] + second[k + 1]) / 6.0;
            c[2] = 0.5 * second[k];
            c[3] = (second[k + 1] - second[k]) / (6.0 * h(k));
        }
    }
}

}  // namespace orbid::models
