#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "models/formulas/expression_graph.hpp"

namespace orbid::models {

/// Formulas as C++: a statement for each part that is used more than once, and one formula for each result.
///
/// A part used once gets no name: a named LocalDual is stored and read again, which took 1.4 times as long (flows of
/// Lorenz's equations).
class FormulaText {
public:
    using Node = ExpressionGraph::Node;

    /// @param graph     must outlive this object
    /// @param one_side  the side of a switching surface is a number, not an array
    FormulaText(const ExpressionGraph& graph, const std::vector<Node>& results, bool one_side);

    /// The statements that results refer to.
    [[nodiscard]] std::string definitions() const;
    [[nodiscard]] std::string result(std::size_t i) const { return operand(results_[i]); }
    /// All results beside each other.
    [[nodiscard]] std::string list() const;

private:
    [[nodiscard]] bool is_simple(Node node) const;
    [[nodiscard]] bool is_named(Node node) const;
    [[nodiscard]] int depth_in(Node node) const;
    [[nodiscard]] std::string side(std::size_t index) const;
    [[nodiscard]] std::string operand(Node node) const;
    [[nodiscard]] std::string beside(Node node, Node other) const;
    [[nodiscard]] std::string formula(Node node) const;

    const ExpressionGraph& graph_;
    std::vector<Node> results_;
    bool one_side_;
    std::vector<int> uses_, depth_;
};

}  // namespace orbid::models
