#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>

#include "models/definition/model.hpp"
#include "models/formulas/formula_code.hpp"

namespace orbid::models {

/// The coordinates of a model known at run time, in the place of a table.
template <std::size_t n>
struct CoordinateView {
    const Coordinate* first;
    const Coordinate& operator[](std::size_t i) const { return first[i]; }
    [[nodiscard]] const Coordinate* begin() const { return first; }
    [[nodiscard]] const Coordinate* end() const { return first + n; }
};

namespace detail {
template <std::size_t q, std::size_t... i>
constexpr std::array<Parameter, q> numbered_parameters(std::index_sequence<i...>) {
    // The first is the frequency of forced models. InterpretedKernel knows the names.
    return {Parameter{"p", "1", i == 0 ? positive : any_real, 1.0, ""}...};
}

/// Arrays of the variables that a part of a program reads; nullptr where it reads none.
template <class T>
struct Variables {
    const T* coordinates = nullptr;
    const T* constants = nullptr;
    const T* forcing = nullptr;
    const T* inputs = nullptr;
};

/// The first n results of a part of a program; `rest` in the place of those beyond `count`.
template <std::size_t n, class T, class S = double>
Values<T, n> interpreted(const FormulaCode& code, std::size_t count, double rest, const Variables<T>& of,
                         const S* sides = nullptr) {
    T registers[FormulaCode::most_registers];
    // run() reads all but the registers.
    const std::array<T*, FormulaCode::segment_count> given{registers, const_cast<T*>(of.coordinates),
                                                           const_cast<T*>(of.constants), const_cast<T*>(of.forcing),
                                                           const_cast<T*>(of.inputs)};
    code.run(given, sides);
    Values<T, n> results;
    for (std::size_t i = 0; i < n; ++i)
        results[i] = i < count ? code.result(given, i) : T(rest);
    return results;
}

template <class T>
Values<T, EquationProgram::most_constants> interpreted_constants(const EquationProgram& program,
                                                                 const Values<T, EquationProgram::most_parameters>& p) {
    return interpreted<EquationProgram::most_constants, T>(program.constants, program.constant_count, 0.0, {p.data()});
}
}  // namespace detail

/// Common base of all shapes of interpreted models: n coordinates, of which smaller programs leave the last ones
/// unused, and room for parameters and constants. A model of this shape refers to a program and its n coordinates,
/// which must outlive it.
template <std::size_t n>
struct InterpretedShape {
    InterpretedShape(const EquationProgram& program_, std::span<const Coordinate> coordinates_)
        : program(&program_), coordinates{coordinates_.data()} {}

    const EquationProgram* program;
    CoordinateView<n> coordinates;

    static constexpr std::string_view name = "equations";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "";
    static constexpr std::size_t q = EquationProgram::most_parameters;
    static constexpr std::size_t constant_count = EquationProgram::most_constants;
    static constexpr std::array parameters = detail::numbered_parameters<q>(std::make_index_sequence<q>{});

    template <class T>
    Values<T, constant_count> reduced(const Values<T, q>& p) const {
        return detail::interpreted_constants(*program, p);
    }

protected:
    /// @param through  the forcing, or the phase
    template <class T, class S = double>
    State<T, n> rates(const T* through, const State<T, n>& x, const Values<T, constant_count>& c, const T* u,
                      const S* sides = nullptr) const {
        return detail::interpreted<n, T>(program->rates, program->coordinate_count, 0.0,
                                         {x.data(), c.data(), through, u}, sides);
    }
    template <class T>
    T force(const T& phase, const Values<T, constant_count>& c) const {
        return detail::interpreted<1, T>(program->forcing, 1, 0.0, {nullptr, c.data(), &phase})[0];
    }
};

/// x' = f(x).
template <std::size_t n>
struct InterpretedFlow : InterpretedShape<n> {
    using Shape = InterpretedShape<n>;
    using Shape::Shape;
    template <class T>
    State<T, n> rhs(const T& t, const State<T, n>& x, const Values<T, Shape::constant_count>& c) const {
        return Shape::rates(&t, x, c, &t);
    }
};

/// x' = f(x, phase).
template <std::size_t n>
struct InterpretedForcedFlow : InterpretedShape<n> {
    using Shape = InterpretedShape<n>;
    using Shape::Shape;
    static constexpr std::size_t forcing_frequency = 0;
    template <class T>
    T forcing(const T& phase, const Values<T, Shape::constant_count>& c) const {
        return Shape::force(phase, c);
    }
    template <class T>
    State<T, n> rhs_forced(const T& force, const State<T, n>& x, const Values<T, Shape::constant_count>& c,
                           const auto& /*side*/) const {
        return Shape::rates(&force, x, c, &force);
    }
    template <class T>
    State<T, n> rhs(const T& phase, const State<T, n>& x, const Values<T, Shape::constant_count>& c) const {
        return rhs_forced<T>(forcing<T>(phase, c), x, c, 0.0);
    }
};

/// One degree of freedom with dry friction.
struct InterpretedFriction : InterpretedShape<2> {
    using Shape = InterpretedShape<2>;
    using Shape::Shape;
    static bool smooth(const Values<double, q>& /*p*/) { return false; }  // InterpretedKernel is not asked
    template <class T, class S>
    State<T, 2> rhs(const T& t, const State<T, 2>& x, const Values<T, constant_count>& c, const S& side) const {
        return Shape::rates(&t, x, c, &t, &side);
    }
};

/// The same, forced.
struct InterpretedForcedFriction : InterpretedShape<2> {
    using Shape = InterpretedShape<2>;
    using Shape::Shape;
    static constexpr std::size_t forcing_frequency = 0;
    static bool smooth(const Values<double, q>& /*p*/) { return false; }
    template <class T>
    T forcing(const T& phase, const Values<T, constant_count>& c) const {
        return Shape::force(phase, c);
    }
    template <class T, class S>
    State<T, 2> rhs_forced(const T& force, const State<T, 2>& x, const Values<T, constant_count>& c,
                           const S& side) const {
        return Shape::rates(&force, x, c, &force, &side);
    }
    template <class T, class S>
    State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, constant_count>& c, const S& side) const {
        return rhs_forced<T>(forcing<T>(phase, c), x, c, side);
    }
};

/// General switching surfaces, up to a fixed number; unused ones are never met.
template <std::size_t n>
struct InterpretedSurfaces : InterpretedShape<n> {
    using Shape = InterpretedShape<n>;
    using Shape::Shape;
    static constexpr std::size_t surface_count = 4;
    static bool smooth(const Values<double, Shape::q>& /*p*/) { return false; }
    template <class T>
    Values<T, surface_count> surfaces(const T& t, const State<T, n>& x,
                                      const Values<T, Shape::constant_count>& c) const {
        return detail::interpreted<surface_count, T>(Shape::program->surfaces, Shape::program->surface_count, 1.0,
                                                     {x.data(), c.data(), &t, &t});
    }
    template <class T>
    State<T, n> rhs(const T& t, const State<T, n>& x, const Values<T, Shape::constant_count>& c,
                    const std::array<double, surface_count>& sides) const {
        return Shape::rates(&t, x, c, &t, sides.data());
    }
};

/// The same, forced.
template <std::size_t n>
struct InterpretedForcedSurfaces : InterpretedSurfaces<n> {
    using InterpretedSurfaces<n>::InterpretedSurfaces;
    static constexpr std::size_t forcing_frequency = 0;
};

/// With measured inputs, up to a fixed number; unused ones are 0.
template <std::size_t n>
struct InterpretedInputs : InterpretedShape<n> {
    using Shape = InterpretedShape<n>;
    using Shape::Shape;
    static constexpr std::array inputs{real("u1", "1"), real("u2", "1"), real("u3", "1"), real("u4", "1")};
    template <class T>
    State<T, n> rhs(const T& t, const State<T, n>& x, const Values<T, Shape::constant_count>& c,
                    const std::array<T, 4>& u) const {
        return Shape::rates(&t, x, c, u.data());
    }
};

/// One degree of freedom with dry friction and measured inputs.
struct InterpretedFrictionInputs : InterpretedShape<2> {
    using Shape = InterpretedShape<2>;
    using Shape::Shape;
    static constexpr auto inputs = InterpretedInputs<2>::inputs;
    static bool smooth(const Values<double, q>& /*p*/) { return false; }
    template <class T, class S>
    State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, constant_count>& c, const S& side,
                    const std::array<T, 4>& u) const {
        return Shape::rates(u.data(), x, c, u.data(), &side);
    }
};

/// x -> F(x).
template <std::size_t n>
struct InterpretedMap : InterpretedShape<n> {
    using Shape = InterpretedShape<n>;
    using Shape::Shape;
    template <class T>
    State<T, n> map(const State<T, n>& x, const Values<T, Shape::constant_count>& c) const {
        return Shape::rates(x.data(), x, c, x.data());
    }
};

/// Autonomous and smooth, of any number of coordinates.
struct InterpretedLargeFlow {
    InterpretedLargeFlow(const EquationProgram& program_, std::span<const Coordinate> /*reals, as `coordinate`*/)
        : program(&program_) {}

    const EquationProgram* program;

    static constexpr std::string_view name = "equations";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "";
    static constexpr Coordinate coordinate = real("x", "1");
    static constexpr std::size_t q = InterpretedShape<1>::q;
    static constexpr auto parameters = InterpretedShape<1>::parameters;
    static constexpr std::size_t smallest_size = 1;
    static constexpr std::size_t default_size = 5;
    template <class T>
    void rhs(const T& t, std::span<const T> x, const Values<T, q>& p, std::span<T> f) const {
        const auto c = detail::interpreted_constants(*program, p);
        T registers[FormulaCode::most_registers];
        const std::array<T*, FormulaCode::segment_count> given{
            registers, const_cast<T*>(x.data()), const_cast<T*>(c.data()), const_cast<T*>(&t), const_cast<T*>(&t)};
        program->rates.run(given, static_cast<const double*>(nullptr));
        for (std::size_t i = 0; i < f.size(); ++i)
            f[i] = program->rates.result(given, i);
    }
};

}  // namespace orbid::models

template <std::size_t n>
struct std::tuple_size<orbid::models::CoordinateView<n>> : std::integral_constant<std::size_t, n> {};
