#include "models/formulas/expression_graph.hpp"

#include <bit>
#include <cmath>
#include <limits>

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Entry = ExpressionGraph::Entry;
using Operation = ExpressionGraph::Operation;

// Products of up to 64 factors take at most eleven multiplications, and lose less than a digit; beyond, pow() is as
// fast.
constexpr double largest_written_power = 64.0;

void need_operands(const Entry& entry, std::vector<bool>& needed) {
    if (is_binary(entry.operation) || is_unary(entry.operation)) needed[entry.a] = true;
    if (is_binary(entry.operation)) needed[entry.b] = true;
}

}  // namespace

Node ExpressionGraph::insert(const Entry& entry) {
    const bool commutes = entry.operation == Operation::add || entry.operation == Operation::multiply;
    const Node first = commutes ? std::min(entry.a, entry.b) : entry.a;
    const Node second = commutes ? std::max(entry.a, entry.b) : entry.b;
    const auto [at, inserted] = known_.try_emplace(
        std::tuple(entry.operation, first, second, std::bit_cast<std::uint64_t>(entry.value), entry.index),
        static_cast<Node>(entries_.size()));
    if (inserted) entries_.push_back(entry);
    return at->second;
}

Node ExpressionGraph::number(double value) {
    return insert({Operation::number, 0, 0, value, 0});
}

Node ExpressionGraph::variable(Operation operation, std::size_t index) {
    return insert({operation, 0, 0, 0.0, static_cast<std::uint32_t>(index)});
}

Node ExpressionGraph::apply(Operation operation, Node a) {
    const Entry operand = entries_[a];
    if (operand.operation == Operation::number) return number(value_of_operation(operation, operand.value));
    if (operand.operation == Operation::negate) {
        if (operation == Operation::negate) return operand.a;
        // A surface and its mirror image are one surface.
        if (operation == Operation::abs) return apply(Operation::abs, operand.a);
        if (operation == Operation::sign) return apply(Operation::negate, apply(Operation::sign, operand.a));
    }
    return insert({operation, a, 0, 0.0, 0});
}

Node ExpressionGraph::apply(Operation operation, Node a, Node b) {
    const Entry left = entries_[a], right = entries_[b];
    const bool known_a = left.operation == Operation::number, known_b = right.operation == Operation::number;
    if (known_a && known_b) return number(value_of_operation(operation, left.value, right.value));
    // What changes no value: neutral elements, and signs that an addition takes over.
    switch (operation) {
        case Operation::add:
            if (known_a && left.value == 0.0) return b;
            if (known_b && right.value == 0.0) return a;
            if (right.operation == Operation::negate) return apply(Operation::subtract, a, right.a);
            break;
        case Operation::subtract:
            if (known_a && left.value == 0.0) return apply(Operation::negate, b);
            if (known_b && right.value == 0.0) return a;
            if (right.operation == Operation::negate) return apply(Operation::add, a, right.a);
            break;
        case Operation::multiply:
            if (known_a && left.value == 1.0) return b;
            if (known_b && right.value == 1.0) return a;
            if (known_a && left.value == -1.0) return apply(Operation::negate, b);
            if (known_b && right.value == -1.0) return apply(Operation::negate, a);
            break;
        case Operation::divide:
            if (known_b && right.value == 1.0) return a;
            break;
        case Operation::power: {
            if (!known_b) break;
            const double exponent = std::abs(right.value), twice = 2.0 * exponent;
            if (!(exponent <= largest_written_power) || twice != std::floor(twice)) break;
            const auto whole = static_cast<unsigned>(exponent);
            const bool half = exponent != std::floor(exponent);
            Node product = whole_power(a, whole);
            if (half) product = apply(Operation::multiply, product, apply(Operation::sqrt, a));
            return right.value < 0.0 ? apply(Operation::divide, number(1.0), product) : product;
        }
        default:
            break;
    }
    return insert({operation, a, b, 0.0, 0});
}

Node ExpressionGraph::whole_power(Node base, unsigned exponent) {
    if (exponent == 0) return number(1.0);
    if (exponent == 1) return base;
    const Node half = whole_power(base, exponent / 2);
    const Node square = apply(Operation::multiply, half, half);
    return exponent % 2 == 0 ? square : apply(Operation::multiply, square, base);
}

Node ExpressionGraph::insert(const Expression& expression, std::span<const Node> names) {
    std::vector<Node> stack;
    for (const Expression::Step& step : expression.steps()) {
        if (step.operation == Operation::number) {
            stack.push_back(number(step.constant));
        } else if (step.operation == Operation::parameter) {
            stack.push_back(names[step.index]);
        } else if (is_binary(step.operation)) {
            const Node last = stack.back();
            stack.pop_back();
            stack.back() = apply(step.operation, stack.back(), last);
        } else {
            stack.back() = apply(step.operation, stack.back());
        }
    }
    return stack.back();
}

Node ExpressionGraph::replace(Node node, const std::function<std::optional<Node>(Node)>& replaced,
                              std::map<Node, Node>& known) {
    // Operands come before the nodes that use them: what the node needs is found backwards, and computed forwards.
    std::vector<bool> needed(node + 1, false);
    needed[node] = true;
    for (Node i = node + 1; i-- > 0;) {
        if (!needed[i] || known.count(i) > 0) continue;
        if (const auto other = replaced(i)) {
            known[i] = *other;
            continue;
        }
        need_operands(entries_[i], needed);
    }
    for (Node i = 0; i <= node; ++i) {
        if (!needed[i] || known.count(i) > 0) continue;
        const Entry entry = entries_[i];
        Node made = i;
        if (is_binary(entry.operation)) made = apply(entry.operation, known.at(entry.a), known.at(entry.b));
        if (is_unary(entry.operation)) made = apply(entry.operation, known.at(entry.a));
        known[i] = made;
    }
    return known.at(node);
}

bool ExpressionGraph::contains(Node node, Node part) const {
    std::vector<bool> needed(node + 1, false);
    needed[node] = true;
    for (Node i = node + 1; i-- > 0;) {
        if (!needed[i]) continue;
        if (i == part) return true;
        need_operands(entries_[i], needed);
    }
    return false;
}

std::vector<double> ExpressionGraph::values(std::span<const Node> wanted,
                                            const std::function<double(const Entry&)>& variable) const {
    std::vector<double> all(entries_.size(), std::numeric_limits<double>::quiet_NaN());
    Node last = 0;
    for (const Node node : wanted)
        last = std::max(last, node);
    for (Node i = 0; i <= last && i < entries_.size(); ++i) {
        const Entry& entry = entries_[i];
        if (entry.operation == Operation::number) {
            all[i] = entry.value;
        } else if (is_variable(entry.operation)) {
            all[i] = variable(entry);
        } else if (is_binary(entry.operation)) {
            all[i] = value_of_operation(entry.operation, all[entry.a], all[entry.b]);
        } else {
            all[i] = value_of_operation(entry.operation, all[entry.a]);
        }
    }
    std::vector<double> result;
    for (const Node node : wanted)
        result.push_back(all[node]);
    return result;
}

}  // namespace orbid::models
