#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <utility>

#include "models/trajectories/stepper.hpp"

namespace orbid::models {

/// The constants of a model converted to another scalar To, with their derivatives where To carries them.
template <class To, class T, std::size_t q>
std::array<To, q> constants_as(const std::array<T, q>& c) {
    std::array<To, q> converted;
    for (std::size_t i = 0; i < q; ++i)
        if constexpr (requires { To(c[i], {}); })
            converted[i] = To(c[i], {});
        else
            converted[i] = To(value_of(c[i]));
    return converted;
}

/// Which surfaces are impacts.
template <SurfaceModel M>
constexpr std::array<bool, surface_count_of<M>> impacts_of() {
    if constexpr (ImpactModel<M>)
        return M::impacts;
    else
        return {};
}

/// Field of a model with switching surfaces: on its sides, or sliding along a surface that both one-sided fields f+ and
/// f- point at (Filippov),
///
///     f_s = (r+ f- - r- f+) / (r+ - r-),   r = dh/ds along a field = h_x f + h_t
///
/// with every derivative exact: r is computed in dual arithmetic along the motion, over the scalar of the trajectory.
template <SurfaceModel M, std::size_t N, std::size_t order = 1>
struct SurfaceField : Field<M, N, order> {
    using Base = Field<M, N, order>;
    using T = typename Base::T;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t m = surface_count_of<M>;
    using Point = State<T, n>;
    /// A quantity and its rate of change along a field.
    using Moving = Dual<1, T>;

    static constexpr std::size_t nothing = m;
    std::size_t held = nothing;  ///< surface along which the solution slides

    SurfaceField(const Values<T, parameter_count_of<M>>& p, double phase_, Clock clock_, const M& model_ = M())
        : Base(p, phase_, clock_, model_) {
        this->side.fill(1.0);
    }

    template <class S>
    [[nodiscard]] Point operator()(const Point& x, const S& s) const {
        if (held == nothing) return one_sided(x, s, this->side);
        const auto [up, down] = halves(x, s);
        const T inverse = 1.0 / (up.rate - down.rate);
        Point f;
        for (std::size_t i = 0; i < n; ++i)
            f[i] = (up.rate * down.f[i] - down.rate * up.f[i]) * inverse;
        return f;
    }
    template <class S>
    [[nodiscard]] Point one_sided(const Point& x, const S& s, const Side<M>& on_sides) const {
        return Base::operator()(x, s, on_sides);
    }

    /// First argument of the equations at s.
    template <class S>
    [[nodiscard]] T time(const S& s) const {
        if constexpr (ForcedModel<M>) {
            if (this->clock == Clock::time) return this->omega * s + this->phase;
            return T(this->phase + s);
        } else if constexpr (InputModel<M>) {
            return T(this->phase + s);
        } else {
            return T(s);
        }
    }

    /// h of every surface.
    template <class S>
    [[nodiscard]] Values<T, m> surfaces(const Point& x, const S& s) const {
        return this->model.surfaces(time(s), x, this->constants);
    }

    /// h of every surface with its rate along f.
    template <class S>
    [[nodiscard]] Values<Moving, m> moving(const Point& x, const Point& f, const S& s) const {
        State<Moving, n> y;
        for (std::size_t i = 0; i < n; ++i)
            y[i] = Moving(x[i], {f[i]});
        T time_rate(1.0);
        if constexpr (ForcedModel<M>)
            if (this->clock == Clock::time) time_rate = this->omega;
        return this->model.surfaces(Moving(time(s), {time_rate}), y, constants_as<Moving>(this->constants));
    }

    /// The fields on both sides of the surface that holds the solution, and the rates of h along them.
    struct Half {
        Point f;
        T rate;
    };
    template <class S>
    [[nodiscard]] std::pair<Half, Half> halves(const Point& x, const S& s) const {
        const auto half = [&](double on) {
            Side<M> sides = this->side;
            sides[held] = on;
            const Point f = one_sided(x, s, sides);
            return Half{f, moving(x, f, s)[held].partial[0]};
        };
        return {half(1.0), half(-1.0)};
    }

    /// x moved onto the holding surface, in the direction in which the one-sided fields differ. With x on its way to
    /// the surface and derivatives X, X - (f+ - f-) / (r+ - r-) (h_x X + h_theta) is (M5) for the start of sliding.
    [[nodiscard]] Point pulled_back(Point x, double s) const {
        // The second pass removes the error due to the curvature of the surface; derivatives are tangent after the
        // first.
        for (int pass = 0; pass < 2; ++pass) {
            const T h = surfaces(x, s)[held];
            const auto [up, down] = halves(x, s);
            const T factor = h / (up.rate - down.rate);
            for (std::size_t i = 0; i < n; ++i)
                x[i] = x[i] - (up.f[i] - down.f[i]) * factor;
        }
        return x;
    }
};

/// How a solution continues from a point on one or more surfaces.
template <std::size_t m>
struct Continuation {
    std::array<double, m> side;
    std::size_t held;  ///< m: none
};

/// Looks for sides whose field leaves all surfaces that the point lies on, or for one surface that holds the solution
/// while it leaves the others. Strict inequalities first; then fields tangent to a surface (an equilibrium on it).
///
/// @param on      surfaces on which the point lies
/// @param impact  of which the side -1 does not exist
/// @param side    sides of the other surfaces
/// @param rates   rates of all h along the field of given sides
/// @return nothing where two surfaces hold the solution at once, or an impact did not send it away
template <std::size_t m, class Rates>
std::optional<Continuation<m>> continuation(const std::array<bool, m>& on, const std::array<bool, m>& impact,
                                            const std::array<double, m>& side, const Rates& rates) {
    std::array<std::size_t, m> open{};
    std::size_t count = 0;
    for (std::size_t j = 0; j < m; ++j)
        if (on[j]) open[count++] = j;
    // Bit i of a choice: side +1 of the surface open[i]. Surface `but` is left out.
    const auto sides_of = [&](std::size_t choice) {
        auto sides = side;
        for (std::size_t i = 0; i < count; ++i)
            sides[open[i]] = (choice >> i & 1U) != 0 ? 1.0 : -1.0;
        return sides;
    };
    const auto exists = [&](const std::array<double, m>& sides) {
        for (std::size_t i = 0; i < count; ++i)
            if (impact[open[i]] && sides[open[i]] < 0.0) return false;
        return true;
    };
    const auto leaves = [&](const std::array<double, m>& sides, const std::array<double, m>& rate, std::size_t but,
                            bool strictly) {
        for (std::size_t i = 0; i < count; ++i) {
            const double away = sides[open[i]] * rate[open[i]];
            if (open[i] != but && !(strictly ? away > 0.0 : away >= 0.0)) return false;
        }
        return true;
    };
    for (const bool strictly : {true, false}) {
        for (std::size_t choice = 0; choice < std::size_t{1} << count; ++choice) {
            const auto sides = sides_of(choice);
            if (exists(sides) && leaves(sides, rates(sides), m, strictly)) return Continuation<m>{sides, m};
        }
        for (std::size_t i = 0; i < count; ++i)
            for (std::size_t choice = 0; choice < std::size_t{1} << count; ++choice) {
                const std::size_t j = open[i];
                auto sides = sides_of(choice);
                if (impact[j] || sides[j] < 0.0 || !exists(sides)) continue;
                const auto up = rates(sides);
                sides[j] = -1.0;
                const auto down = rates(sides);
                if (!(up[j] <= 0.0 && down[j] >= 0.0 && down[j] > up[j])) continue;
                std::array<double, m> along;
                for (std::size_t k = 0; k < m; ++k)
                    along[k] = (up[j] * down[k] - down[j] * up[k]) / (up[j] - down[j]);
                if (leaves(sides, along, j, strictly)) return Continuation<m>{sides, j};
            }
    }
    return std::nullopt;
}

}  // namespace orbid::models
