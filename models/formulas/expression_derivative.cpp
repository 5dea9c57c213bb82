#include <optional>

#include "models/formulas/expression_graph.hpp"

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Entry = ExpressionGraph::Entry;
using Operation = ExpressionGraph::Operation;
using Part = std::optional<Node>;

/// Rules of differentiation for one node of a graph. Its own value is an operand of some.
class DerivativeRules {
public:
    DerivativeRules(ExpressionGraph& graph, Node node)
        : graph_(graph), entry_(graph[node]), i_(node), a_(entry_.a), b_(entry_.b), one_(graph.number(1.0)) {}

    /// Of an operation on two operands, by the derivatives of both.
    Part binary(Part da, Part db) {
        switch (entry_.operation) {
            case Operation::add:
                return sum(da, db);
            case Operation::subtract:
                return sum(da, db ? Part(minus(*db)) : Part());
            case Operation::multiply: {
                const Part first = da ? Part(times(*da, b_)) : Part();
                return sum(first, db ? Part(times(a_, *db)) : Part());
            }
            case Operation::divide: {
                const Part first = da ? Part(over(*da, b_)) : Part();
                return sum(first, db ? Part(minus(over(times(i_, *db), b_))) : Part());
            }
            default: {  // power
                const Part first =
                    da ? Part(times(times(b_, apply(Operation::power, a_, apply(Operation::subtract, b_, one_))), *da))
                       : Part();
                return sum(first, db ? Part(times(times(i_, apply(Operation::log, a_)), *db)) : Part());
            }
        }
    }

    /// Of an operation on one.
    Part unary(Node da) {
        switch (entry_.operation) {
            case Operation::negate:
                return minus(da);
            case Operation::sin:
                return times(apply(Operation::cos, a_), da);
            case Operation::cos:
                return minus(times(apply(Operation::sin, a_), da));
            case Operation::tan:
                return times(apply(Operation::add, one_, times(i_, i_)), da);
            case Operation::asin:
                return over(da, root());
            case Operation::acos:
                return minus(over(da, root()));
            case Operation::atan:
                return over(da, apply(Operation::add, one_, times(a_, a_)));
            case Operation::sinh:
                return times(apply(Operation::cosh, a_), da);
            case Operation::cosh:
                return times(apply(Operation::sinh, a_), da);
            case Operation::tanh:
                return times(times(apply(Operation::subtract, one_, i_), apply(Operation::add, one_, i_)), da);
            case Operation::exp:
                return times(i_, da);
            case Operation::log:
                return over(da, a_);
            case Operation::sqrt:
                return over(times(graph_.number(0.5), da), i_);
            case Operation::abs:
                return times(apply(Operation::sign, a_), da);
            default:  // sign is constant
                return std::nullopt;
        }
    }

private:
    Node apply(Operation operation, Node x) { return graph_.apply(operation, x); }
    Node apply(Operation operation, Node x, Node y) { return graph_.apply(operation, x, y); }
    Node times(Node x, Node y) { return apply(Operation::multiply, x, y); }
    Node over(Node x, Node y) { return apply(Operation::divide, x, y); }
    Node minus(Node x) { return apply(Operation::negate, x); }
    /// sqrt(1 - a^2)
    Node root() {
        return apply(Operation::sqrt, times(apply(Operation::subtract, one_, a_), apply(Operation::add, one_, a_)));
    }
    Part sum(Part x, Part y) { return x && y ? Part(apply(Operation::add, *x, *y)) : x ? x : y; }

    ExpressionGraph& graph_;
    const Entry entry_;
    Node i_, a_, b_, one_;
};

}  // namespace

std::optional<Node> ExpressionGraph::derivative(Node node, Node variable) {
    if (node == variable) return number(1.0);
    // In the order of the nodes: a recursion would go as deep as the formula.
    for (Node i = 0; i <= node; ++i) {
        const auto [at, fresh] = derivatives_.try_emplace({i, variable});
        if (!fresh) continue;
        const Operation operation = entries_[i].operation;
        const Node a = entries_[i].a, b = entries_[i].b;
        if (i == variable) {
            at->second = number(1.0);
        } else if (is_unary(operation)) {
            DerivativeRules rules(*this, i);
            if (const Part da = derivatives_.at({a, variable})) at->second = rules.unary(*da);
        } else if (is_binary(operation)) {
            DerivativeRules rules(*this, i);
            const Part da = derivatives_.at({a, variable}), db = derivatives_.at({b, variable});
            if (da || db) at->second = rules.binary(da, db);
        }
    }
    return derivatives_.at({node, variable});
}

}  // namespace orbid::models
