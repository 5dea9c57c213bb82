#pragma once

#include <vector>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/solution/newton.hpp"

namespace orbid::periodic {

/// Square root of min_d |d|^2 + weight |J d + r|^2: how far the guess has to move to close, according to the linearised
/// equations. A closing error may remain that the weight makes expensive. All in units of the scales.
[[nodiscard]] double shortest_correction(const ClosingError& closing, const VectorXd& scale, double weight);

/// A guess on its way to an orbit.
struct CorrectedGuess {
    bool closed = false;  ///< closing error below 1e-4 of the scale, rms: Newton's method is left a small step
    MatrixXd nodes;
    double time = 0.0;
    ClosingError closing;  ///< there, turns taken off
};

/// Moves a guess as little as closing it takes:
///
///     minimise |z - g|^2 + mu |F(z)|^2   for mu = 1, 10, 100, ...
///
/// both in units of the scales, by damped Gauss-Newton steps, each from the solution before it. Where the derivative of
/// F is nearly singular, near folds and on long orbits, Newton's first step leads far away to another orbit. This path
/// does not, as distance is penalised from the beginning.
///
/// @param measured  nodes that count in |z - g|; others (between measured points) go where the equations want them.
///                  ln T counts as a coordinate of size one.
/// @param closing   at the guess, turns taken off.
/// Cost: 8 to 15 evaluations of the closing error, each with a sparse factorisation linear in the number of nodes.
[[nodiscard]] CorrectedGuess corrected_guess(const DiscreteEquations& equations, const MatrixXd& guess, double time,
                                             const ClosingError& closing, const std::vector<Index>& measured);

}  // namespace orbid::periodic
