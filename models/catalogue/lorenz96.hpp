#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// One quantity of the atmosphere at n places on a circle of latitude: advection, damping and constant forcing.
///
///     x_i' = (x_{i+1} - x_{i-2}) x_{i-1} - x_i + F,   i mod n
///
/// State, shape (n), without units; time in units of the damping (5 days in the source). The advection keeps
/// sum x_i^2. All x_i = F is an equilibrium.
/// Source: E. N. Lorenz, "Predictability: a problem partly solved", Proceedings of the ECMWF Seminar on Predictability,
/// volume 1, pages 1-18 (1996); 40 places and F = 8 are the values of E. N. Lorenz and K. A. Emanuel, "Optimal sites
/// for supplementary weather observations", Journal of the Atmospheric Sciences 55:399-414 (1998).
struct Lorenz96 {
    static constexpr std::string_view name = "lorenz96";
    static constexpr std::string_view summary = "advection, damping and forcing at n places on a circle of latitude";
    static constexpr std::string_view equations = "xi' = (x(i+1) - x(i-2)) x(i-1) - xi + F, i mod n";

    static constexpr Coordinate coordinate = real("x", "1");
    /// With fewer, i + 1, i, i - 1 and i - 2 are not four different places.
    static constexpr std::size_t smallest_size = 4;
    static constexpr std::size_t default_size = 40;
    static constexpr std::array parameters{Parameter{"F", "1", any_real, 8.0, "forcing"}};

    template <class T>
    static void rhs(const T& /*t*/, std::span<const T> x, const Values<T, 1>& p, std::span<T> f) {
        const std::size_t n = x.size();
        // The first two places and the last one reach around the circle.
        f[0] = (x[1] - x[n - 2]) * x[n - 1] - x[0] + p[0];
        f[1] = (x[2] - x[n - 1]) * x[0] - x[1] + p[0];
        for (std::size_t i = 2; i + 1 < n; ++i)
            f[i] = (x[i + 1] - x[i - 2]) * x[i - 1] - x[i] + p[0];
        f[n - 1] = (x[0] - x[n - 3]) * x[n - 2] - x[n - 1] + p[0];
    }
};

}  // namespace orbid::models
