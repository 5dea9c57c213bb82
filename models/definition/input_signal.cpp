#include "models/definition/input_signal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "models/arithmetic/band_limited.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::models {

namespace {

using Interpolation = InputSignal::Interpolation;

std::size_t terms_of(Interpolation interpolation) {
    constexpr std::size_t terms[] = {2, 4, 1, 8};
    return terms[static_cast<std::size_t>(interpolation)];
}

void require(bool rule, const std::string& message) {
    if (!rule) throw DataError("input signal: " + message);
}

void require_equidistant(std::span<const double> times) {
    constexpr double tolerance = 0.05;  // of a step
    const double step = (times.back() - times.front()) / static_cast<double>(times.size() - 1);
    for (std::size_t k = 0; k < times.size(); ++k) {
        const double due = times.front() + static_cast<double>(k) * step;
        require(std::abs(times[k] - due) <= tolerance * step,
                fmt::format("time {} is {} s, must be {} s within {} % of a step: a band-limited signal needs "
                            "equidistant instants (a cubic one does not)",
                            k, times[k], due, 100.0 * tolerance));
    }
}

/// u'' of the natural cubic spline at the instants.
std::vector<double> spline_second_derivatives(std::span<const double> times, std::span<const double> u) {
    const std::size_t pieces = times.size() - 1;
    std::vector<double> second(times.size());
    std::vector<double> pivot(times.size());
    const auto h = [&](std::size_t k) { return times[k + 1] - times[k]; };
    // Continuity of u' at the inner instants: a tridiagonal system for u'', eliminated and substituted back.
    for (std::size_t k = 1; k < pieces; ++k) {
        pivot[k] = 2.0 * (h(k - 1) + h(k));
        second[k] = 6.0 * ((u[k + 1] - u[k]) / h(k) - (u[k] - u[k - 1]) / h(k - 1));
        if (k > 1) {
            const double factor = h(k - 1) / pivot[k - 1];
            pivot[k] -= factor * h(k - 1);
            second[k] -= factor * second[k - 1];
        }
    }
    for (std::size_t k = pieces; k-- > 1;)
        second[k] = (second[k] - h(k) * second[k + 1]) / pivot[k];
    return second;
}

/// The coefficients of one input's pieces, shape (terms, pieces).
std::vector<double> piece_coefficients(std::span<const double> times, std::span<const double> u,
                                       Interpolation interpolation) {
    const std::size_t pieces = times.size() - 1;
    const std::size_t terms = terms_of(interpolation);
    std::vector<double> coefficients(pieces * terms);
    std::vector<double> second;
    std::vector<std::array<double, 3>> derivatives;
    if (interpolation == Interpolation::cubic) second = spline_second_derivatives(times, u);
    if (interpolation == Interpolation::band_limited) derivatives = band_limited_derivatives(u);
    for (std::size_t k = 0; k < pieces; ++k) {
        const double h = times[k + 1] - times[k];
        double* c = coefficients.data() + k * terms;
        c[0] = u[k];
        if (interpolation == Interpolation::linear) c[1] = (u[k + 1] - u[k]) / h;
        if (interpolation == Interpolation::cubic) {
            c[1] = (u[k + 1] - u[k]) / h - h * (2.0 * second[k] + second[k + 1]) / 6.0;
            c[2] = 0.5 * second[k];
            c[3] = (second[k + 1] - second[k]) / (6.0 * h);
        }
        if (interpolation == Interpolation::band_limited) {
            const auto septic = hermite_septic(u[k], derivatives[k], u[k + 1], derivatives[k + 1]);
            double power = 1.0;
            for (std::size_t i = 1; i < terms; ++i)
                c[i] = septic[i] / (power *= h);
        }
    }
    return coefficients;
}

}  // namespace

InputSignal::InputSignal(std::span<const double> times, std::span<const double> values, std::size_t count,
                         Interpolation interpolation)
    : times_(times.begin(), times.end()),
      count_(count),
      terms_(terms_of(interpolation)),
      interpolation_(interpolation) {
    if (count == 0) throw std::invalid_argument("input signal: number of inputs is 0, must be > 0");
    if (values.size() != count * times.size())
        throw std::invalid_argument(
            fmt::format("input signal: number of values is {}, must be {}", values.size(), count * times.size()));
    require(times.size() >= 2, fmt::format("number of instants is {}, must be >= 2", times.size()));
    for (std::size_t k = 0; k < times.size(); ++k) {
        require(std::isfinite(times[k]), fmt::format("time {} is {}, must be a finite number", k, times[k]));
        require(k == 0 || times[k] > times[k - 1],
                fmt::format("time {} is {} s, must be > {} s: times ascend", k, times[k], k == 0 ? 0.0 : times[k - 1]));
        for (std::size_t i = 0; i < count; ++i)
            require(std::isfinite(values[k * count + i]),
                    fmt::format("value {} of input {} is {}, must be a finite number", k, i, values[k * count + i]));
    }
    if (interpolation == Interpolation::band_limited) require_equidistant(times);
    const std::size_t pieces = times.size() - 1;
    coefficients_.resize(pieces * count * terms_);
    std::vector<double> one(times.size());
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t k = 0; k < times.size(); ++k)
            one[k] = values[k * count + i];
        const std::vector<double> of_one = piece_coefficients(times, one, interpolation);
        for (std::size_t k = 0; k < pieces; ++k)
            std::copy_n(of_one.data() + k * terms_, terms_, coefficients_.data() + (k * count + i) * terms_);
    }
}

std::string_view name(InputSignal::Interpolation interpolation) {
    constexpr std::string_view names[] = {"linear", "cubic", "held", "band_limited"};
    return names[static_cast<std::size_t>(interpolation)];
}

}  // namespace orbid::models
