#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Light that goes round a ring cavity with a nonlinear medium.
///
///     z -> p + B z exp(i (kappa - alpha / (1 + |z|^2))),   z = x + i y
///
/// State, shape (2): x, y, real and imaginary part of the field, without units. The Jacobian's determinant is B^2
/// everywhere.
/// Source: K. Ikeda, "Multiple-valued stationary state and its instability of the transmitted light by a ring cavity
/// system", Optics Communications 30:257-261 (1979), in the form of S. M. Hammel, C. K. R. T. Jones, J. V. Moloney,
/// "Global dynamical behavior of the optical field in a ring cavity", Journal of the Optical Society of America B
/// 2:552-564 (1985). Defaults: the chaotic case in common use.
struct Ikeda {
    static constexpr std::string_view name = "ikeda";
    static constexpr std::string_view summary = "light that goes round a ring cavity with a nonlinear medium";
    static constexpr std::string_view equations = "z -> p + B z exp(i (kappa - alpha / (1 + |z|^2))), z = x + i y";

    static constexpr std::array coordinates{real("x", "1"), real("y", "1")};
    static constexpr std::array parameters{Parameter{"p", "1", any_real, 1.0, "light that enters per turn"},
                                           Parameter{"B", "1", any_real, 0.9, "field that is kept per turn"},
                                           Parameter{"kappa", "rad", any_real, 0.4, "detuning of the empty cavity"},
                                           Parameter{"alpha", "rad", any_real, 6.0, "detuning by the medium"}};

    template <class T>
    static State<T, 2> map(const State<T, 2>& x, const Values<T, 4>& p) {
        using std::cos, std::sin;
        const T turn = p[2] - p[3] / (1.0 + x[0] * x[0] + x[1] * x[1]);
        const T c = p[1] * cos(turn), s = p[1] * sin(turn);
        return {p[0] + c * x[0] - s * x[1], s * x[0] + c * x[1]};
    }
};

}  // namespace orbid::models
