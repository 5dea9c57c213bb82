#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>
#include <tuple>

#include "models/definition/model_check.hpp"

/// Sound parts of a model, from which each broken one is put together with one part missing or wrong.
namespace orbid::models::parts {

struct Texts {
    static constexpr std::string_view name = "broken";
    static constexpr std::string_view summary = "one defect";
    static constexpr std::string_view equations = "x'' = -k x";
};

struct Coordinates {
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s")};
};

struct Parameters {
    static constexpr std::array parameters{Parameter{"k", "1/s^2", positive, 1.0, "stiffness"},
                                           Parameter{"c", "1/s", nonnegative, 0.0, "friction", typical(0.1)}};
};

struct Equations {
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& p) {
        return {x[1], -p[0] * x[0] - p[1] * x[1]};
    }
};

/// Equations with a side.
struct SidedEquations {
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& p, double side) {
        return {x[1], -p[0] * x[0] - side * p[1]};
    }
};

struct Smooth {
    static bool smooth(const Values<double, 2>& p) { return p[1] == 0.0; }
};

/// A switching surface x = 0, and equations with its side.
struct Surfaces {
    static constexpr std::size_t surface_count = 1;
    template <class T>
    static Values<T, 1> surfaces(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& /*p*/) {
        return {x[0]};
    }
};
struct SurfaceEquations {
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& p,
                           const std::array<double, 1>& sides) {
        return {x[1], -p[0] * x[0] - sides[0] * p[1]};
    }
};
struct Reset {
    template <class T>
    static State<T, 2> reset(std::size_t /*j*/, const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& /*p*/) {
        return {x[0], -x[1]};
    }
};

struct Map {
    template <class T>
    static State<T, 2> map(const State<T, 2>& x, const Values<T, 2>& p) {
        return {x[1], p[0] * x[0]};
    }
};

/// All that a model needs.
struct Sound : Texts, Coordinates, Parameters, Equations {};

/// All that a model of any size needs.
struct Cells {
    static constexpr Coordinate coordinate = real("x", "m");
    static constexpr std::size_t smallest_size = 2;
    static constexpr std::size_t default_size = 5;
};
struct CellEquations {
    template <class T>
    static void rhs(const T& /*t*/, std::span<const T> x, const Values<T, 2>& p, std::span<T> f) {
        for (std::size_t i = 0; i < x.size(); ++i)
            f[i] = -p[0] * x[i];
    }
};

}  // namespace orbid::models::parts
