#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "models/equations/equations.hpp"

namespace orbid::models {

/// The formulas of a model by how often they are computed: constants once per flow, the forcing once per instant, the
/// rates at every state.
///
///     c = constants(parameters),   force = forcing(phase, c),   f = rates(force, x, inputs, sides, c)
struct StagedEquations {
    using Node = ExpressionGraph::Node;

    ExpressionGraph graph;
    std::vector<Node> constants;  ///< of parameters
    /// As a function of the phase and the constants, when the phase enters through one number only; else the rates read
    /// the phase.
    std::optional<Node> forcing;
    std::vector<Node> rates;     ///< of coordinates, inputs, sides, constants and the forcing or the phase
    std::vector<Node> surfaces;  ///< of coordinates, the phase and constants

    /// d rate / d variable, where it is not 0.
    struct Derivative {
        std::size_t rate;
        Node variable;
        Node derivative;
    };
    /// By the coordinates, the constants and the forcing or phase. Sorted by the rates, then by these.
    [[nodiscard]] std::vector<Derivative> derivatives();
};

/// @param most_constants  with more, the parameters themselves are the constants
/// @param seek_forcing    the caller can tabulate a forcing
[[nodiscard]] StagedEquations staged(const Equations& equations, std::size_t most_constants, bool seek_forcing);

}  // namespace orbid::models
