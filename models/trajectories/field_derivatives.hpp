#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>

#include "models/trajectories/flow.hpp"

namespace orbid::models {

/// The side of each switching surface that a state is on; +1 on the surface itself.
template <Model M>
Side<M> side_of([[maybe_unused]] double phase, [[maybe_unused]] const State<double, dimension_of<M>>& x,
                [[maybe_unused]] const Constants<M, double>& c, [[maybe_unused]] const M& model = M()) {
    Side<M> side{};
    if constexpr (SurfaceModel<M>) {
        const auto h = model.surfaces(phase, x, c);
        for (std::size_t j = 0; j < side.size(); ++j)
            side[j] = h[j] < 0.0 ? -1.0 : 1.0;
    } else if constexpr (SwitchingModel<M>) {
        side = x[velocity] < 0.0 ? -1.0 : 1.0;
    }
    return side;
}

/// f on these sides, or the image of a map.
/// @param input  values of the measured inputs, nullptr for models without
template <Model M, class T>
State<T, dimension_of<M>> f_or_image([[maybe_unused]] const T& phase, const State<T, dimension_of<M>>& x,
                                     const Constants<M, T>& c, [[maybe_unused]] const Side<M>& side,
                                     [[maybe_unused]] const double* input, const M& model = M()) {
    if constexpr (MapModel<M>) {
        return model.map(x, c);
    } else {
        std::array<T, input_count_of<M>> u{};
        if constexpr (InputModel<M>) std::copy(input, input + u.size(), u.begin());
        return rhs_of<M, T>(phase, x, c, side, u, model);
    }
}

/// d f / d(x, free parameters) at a fixed phase, n x (n + f) in column-major order: the equations in dual numbers. For
/// a model that switches: on the side that the state is on. For a map: of its image.
template <Model M>
void store_field_derivatives(double phase, const double* state, const double* theta, const double* input,
                             std::span<const std::ptrdiff_t> free, double* derivatives, const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>, q = parameter_count_of<M>;
    const auto values = array_from<double, n>(state);
    const auto side = side_of<M>(phase, values, constants_from<M, double>(array_from<double, q>(theta), model), model);
    in_passes<M>(free.size(), [&]<std::size_t N>(std::size_t first) {
        using T = Dual<N>;
        auto x = array_from<T, n>(state);
        auto p = array_from<T, q>(theta);
        seed<N, n, q>(x, p, free, first);
        const auto f = f_or_image<M, T>(T(phase), x, constants_from<M, T>(p, model), side, input, model);
        store_partials<N, n>(f, first, n + free.size(), derivatives);
    });
}

/// Second derivatives there, n x (d d), column i d + j for the directions i and j; and d f / d phase. The phase takes
/// its turn as one more direction of the dual numbers.
template <Model M>
void store_second_field_derivatives(double phase, const double* state, const double* theta, const double* input,
                                    std::span<const std::ptrdiff_t> free, double* second, double* by_phase,
                                    const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>, q = parameter_count_of<M>;
    constexpr std::size_t N = wide_chunk<M>;
    using T = Scalar<N, 2>;
    const std::size_t directions = n + free.size();
    const auto values = array_from<double, n>(state);
    const auto side = side_of<M>(phase, values, constants_from<M, double>(array_from<double, q>(theta), model), model);
    for (std::size_t direction = 0; direction <= directions; ++direction) {
        for (std::size_t first = 0; first == 0 || first < free.size(); first += N - n) {
            auto x = array_from<T, n>(state);
            auto p = array_from<T, q>(theta);
            T tau(phase);
            seed<N, n, q>(x, p, free, first);
            if (direction < directions)
                seed_second<N, n, q>(x, p, free, direction);
            else
                tau.partial[0].value = 1.0;
            const auto f = f_or_image<M, T>(tau, x, constants_from<M, T>(p, model), side, input, model);
            if (direction < directions)
                store_second<N, n>(f, first, directions, second + direction * directions * n);
            else
                for (std::size_t i = 0; i < n; ++i)
                    by_phase[i] = f[i].partial[0].value;
        }
    }
}

}  // namespace orbid::models
