#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "models/formulas/expression.hpp"

namespace orbid::models {

/// Formulas as one graph in which every subexpression occurs once, even if several formulas share it.
///
/// Numbers are folded. Whole powers become products (x^3 = x x x), halves of them square roots. All other operations
/// and their order are those of the text: nothing is rearranged that would round differently.
class ExpressionGraph {
public:
    using Node = std::uint32_t;
    using Operation = FormulaOperation;
    struct Entry {
        Operation operation;
        Node a = 0, b = 0;  ///< operands
        double value = 0.0;
        std::uint32_t index = 0;
    };

    [[nodiscard]] const Entry& operator[](Node node) const { return entries_[node]; }
    /// Operands always come before the nodes that use them.
    [[nodiscard]] std::size_t size() const { return entries_.size(); }

    Node number(double value);
    Node variable(Operation operation, std::size_t index);
    /// Of one operand: the functions and negate.
    Node apply(Operation operation, Node a);
    /// add, subtract, multiply, divide, power.
    Node apply(Operation operation, Node a, Node b);

    /// A parsed formula whose names stand for these nodes.
    Node insert(const Expression& expression, std::span<const Node> names);

    /// The same formula over other operands: replaced(node) where it gives one, else the node's own operation on its
    /// replaced operands. `known` keeps replacements from one call to the next.
    Node replace(Node node, const std::function<std::optional<Node>(Node)>& replaced, std::map<Node, Node>& known);

    /// d node / d variable; nothing where it is 0 everywhere. A side is constant; |x| at 0 has the derivative of its
    /// right side.
    std::optional<Node> derivative(Node node, Node variable);

    /// True when the formula contains this node.
    [[nodiscard]] bool contains(Node node, Node part) const;

    /// Values in double of all nodes that `wanted` depend on, given those of the variables. For checks, not loops.
    [[nodiscard]] std::vector<double> values(std::span<const Node> wanted,
                                             const std::function<double(const Entry&)>& variable) const;

private:
    Node insert(const Entry& entry);
    Node whole_power(Node base, unsigned exponent);

    std::vector<Entry> entries_;
    std::map<std::tuple<Operation, Node, Node, std::uint64_t, std::uint32_t>, Node> known_;
    std::map<std::pair<Node, Node>, std::optional<Node>> derivatives_;
};

}  // namespace orbid::models
