#include <optional>
#include <utility>

#include "models/formulas/expression_graph.hpp"

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Entry = ExpressionGraph::Entry;
using Operation = ExpressionGraph::Operation;

}  // namespace

std::optional<Node> ExpressionGraph::derivative(Node node, Node variable) {
    if (node == variable) return number(1.0);
    // In the order of the nodes: a recursion would go as deep as the formula.
    for (Node i = 0; i <= node; ++i) {
        const auto key = std::pair(i, variable);
        if (derivatives_.count(key) > 0) continue;
        const Entry entry = entries_[i];
        if (i == variable) {
            derivatives_[key] = number(1.0);
            continue;
        }
        if (!is_binary(entry.operation) && !is_unary(entry.operation)) {
            derivatives_[key] = std::nullopt;
            continue;
        }
        const auto da = derivatives_.at({entry.a, variable});
        const auto db = is_binary(entry.operation) ? derivatives_.at({entry.b, variable}) : std::nullopt;
        const auto times = [&](Node x, Node y) { return apply(Operation::multiply, x, y); };
        const auto over = [&](Node x, Node y) { return apply(Operation::divide, x, y); };
        const auto minus = [&](Node x) { return apply(Operation::negate, x); };
        const Node a = entry.a, b = entry.b, one = number(1.0);
        std::optional<Node> result;
        const auto plus = [&](std::optional<Node> term) {
            if (term) result = result ? apply(Operation::add, *result, *term) : *term;
        };
        if (da || db) {
            switch (entry.operation) {
                case Operation::add:
                    plus(da);
                    plus(db);
                    break;
                case Operation::subtract:
                    plus(da);
                    if (db) plus(minus(*db));
                    break;
                case Operation::multiply:
                    if (da) plus(times(*da, b));
                    if (db) plus(times(a, *db));
                    break;
                case Operation::divide:
                    if (da) plus(over(*da, b));
                    if (db) plus(minus(over(times(i, *db), b)));
                    break;
                case Operation::power:
                    if (da) plus(times(times(b, apply(Operation::power, a, apply(Operation::subtract, b, one))), *da));
                    if (db) plus(times(times(i, apply(Operation::log, a)), *db));
                    break;
                case Operation::negate:
                    plus(minus(*da));
                    break;
                case Operation::sin:
                    plus(times(apply(Operation::cos, a), *da));
                    break;
                case Operation::cos:
                    plus(minus(times(apply(Operation::sin, a), *da)));
                    break;
                case Operation::tan:
                    plus(times(apply(Operation::add, one, times(i, i)), *da));
                    break;
                case Operation::asin:
                case Operation::acos: {
                    const Node root = apply(Operation::sqrt,
                                            times(apply(Operation::subtract, one, a), apply(Operation::add, one, a)));
                    plus(entry.operation == Operation::asin ? over(*da, root) : minus(over(*da, root)));
                    break;
                }
                case Operation::atan:
                    plus(over(*da, apply(Operation::add, one, times(a, a))));
                    break;
                case Operation::sinh:
                    plus(times(apply(Operation::cosh, a), *da));
                    break;
                case Operation::cosh:
                    plus(times(apply(Operation::sinh, a), *da));
                    break;
                case Operation::tanh:
                    plus(times(times(apply(Operation::subtract, one, i), apply(Operation::add, one, i)), *da));
                    break;
                case Operation::exp:
                    plus(times(i, *da));
                    break;
                case Operation::log:
                    plus(over(*da, a));
                    break;
                case Operation::sqrt:
                    plus(over(times(number(0.5), *da), i));
                    break;
                case Operation::abs:
                    plus(times(apply(Operation::sign, a), *da));
                    break;
                default:  // sign is constant
                    break;
            }
        }
        derivatives_[key] = result;
    }
    return derivatives_.at({node, variable});
}

}  // namespace orbid::models
