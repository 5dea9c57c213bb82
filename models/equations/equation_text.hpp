#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "models/definition/parameter.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// A model written as text, as a job gives it.
struct EquationText {
    struct Quantity {
        std::string name;
        std::string text;  ///< coordinate: its derivative by the time, or its next iterate; definition: what it is
        std::string unit = "1";
        bool angle = false;  ///< of coordinates only
    };
    struct Parameter {
        std::string name;
        std::string unit = "1";
        Domain domain = Domain::real;
        double value = 0.0;                  ///< default
        std::optional<double> typical = {};  ///< > 0; else |value|, or 1 where that is 0
        std::string description = {};
    };
    struct Forcing {
        std::string phase;      ///< name of the phase omega t [rad] in the equations
        std::string frequency;  ///< parameter omega
    };

    std::string name = "equations";
    bool map = false;
    std::vector<Quantity> coordinates;  ///< in the order of the state
    std::vector<Quantity> definitions;  ///< further names, each of what stands before it
    std::vector<Parameter> parameters;
    std::optional<Forcing> forcing = {};
    /// Expressions at whose sign the equations may jump. Nothing: the arguments of all sign() and abs() that depend on
    /// the state or the phase.
    std::optional<std::vector<std::string>> switching = {};
    std::vector<Quantity> inputs = {};  ///< measured; name and unit
    std::optional<Symmetry> symmetry = {};
    bool stiff = false;
    /// Names that formulas outside use, those of a sensor. Parameters and inputs among them may occur in no equation.
    std::vector<std::string> used_outside = {};
};

/// What is wrong with a model written as text, and where.
struct EquationProblem {
    enum class Part { model, coordinate, definition, parameter, forcing, switching, input, symmetry };
    Part part;
    std::size_t index = 0;                ///< in the list of the part
    std::optional<std::size_t> position;  ///< character of its text, from 0; nothing: the name or the whole
    std::string rule;
};

/// A model written as text as a system, evaluated instruction by instruction. No compiler is needed, but it is up to
/// four times slower than a model in C++.
///
/// @return nothing when there are problems; all that can be found at once are added. Models that cannot be interpreted
///         (many coordinates with general switching surfaces, stiff equations) count as a problem of the model.
[[nodiscard]] std::shared_ptr<const System> system_from_text(const EquationText& text,
                                                             std::vector<EquationProblem>& problems);

}  // namespace orbid::models

#pragma GCC visibility pop
