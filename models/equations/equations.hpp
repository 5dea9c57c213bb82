#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "models/definition/parameter.hpp"
#include "models/equations/equation_text.hpp"
#include "models/formulas/expression_graph.hpp"
#include "models/formulas/formula_code.hpp"
#include "models/system/system.hpp"

namespace orbid::models {

/// A model written as text, checked and parsed: its formulas as one graph.
///
/// Flows: for a sign() or abs() with a switching surface h, the sign becomes the side of h, +1 or -1, and abs the side
/// times h. The equations are then smooth on each side. A model has dry friction, with sticking, if it has one degree
/// of freedom (x' = v), v is its only surface, and the jump opposes the motion at the given parameters. All other
/// surfaces are general ones with sliding.
class Equations {
public:
    using Node = ExpressionGraph::Node;
    static constexpr std::size_t longest_name = 100;
    static constexpr std::size_t most_coordinates = 64;
    static constexpr std::size_t most_parameters = EquationProgram::most_parameters;
    static constexpr std::size_t most_surfaces = 8;
    /// For all formulas together. The largest model of the registry has three hundred.
    static constexpr std::size_t most_operations = 5000;

    /// @return nothing when there are problems; all that can be found at once are added.
    [[nodiscard]] static std::shared_ptr<const Equations> read(const EquationText& text,
                                                               std::vector<EquationProblem>& problems);

    [[nodiscard]] const EquationText& text() const { return text_; }
    [[nodiscard]] const ExpressionGraph& graph() const { return graph_; }
    [[nodiscard]] Kind kind() const;
    [[nodiscard]] double evaluation_cost() const;  ///< interpreted, see System::evaluation_cost()
    /// f, or the next iterate, one per coordinate.
    [[nodiscard]] std::span<const Node> rates() const { return rates_; }
    /// h of each switching surface.
    [[nodiscard]] std::span<const Node> surfaces() const { return surfaces_; }
    /// One surface, the velocity of one degree of freedom: SwitchingModel.
    [[nodiscard]] bool dry_friction() const { return dry_friction_; }
    /// Index of the forcing's frequency among the parameters.
    [[nodiscard]] std::optional<std::size_t> frequency() const { return frequency_; }

    /// Tables for Kernel. The texts live as long as this object.
    [[nodiscard]] std::span<const Coordinate> coordinates() const { return coordinates_; }
    [[nodiscard]] std::span<const Parameter> parameters() const { return parameters_; }
    [[nodiscard]] std::span<const Coordinate> inputs() const { return inputs_; }

    /// f does not jump on any surface at these parameters: both sides agree in some arbitrary states on it.
    [[nodiscard]] bool smooth(const double* theta) const;

    Equations(const Equations&) = delete;
    Equations& operator=(const Equations&) = delete;

private:
    friend class EquationReader;
    explicit Equations(const EquationText& text) : text_(text) {}

    EquationText text_;
    ExpressionGraph graph_;
    std::vector<Node> rates_;
    std::vector<Node> surfaces_;
    /// Per surface and coordinate: f on the sides +1 and -1 with h = 0.
    std::vector<std::vector<std::pair<Node, Node>>> on_surface_;
    bool dry_friction_ = false;
    std::optional<std::size_t> frequency_;
    std::vector<Coordinate> coordinates_;
    std::vector<Parameter> parameters_;
    std::vector<Coordinate> inputs_;
};

}  // namespace orbid::models
