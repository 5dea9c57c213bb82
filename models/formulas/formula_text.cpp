#include "models/formulas/formula_text.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Operation = ExpressionGraph::Operation;

/// Brackets of brackets of that many levels are more than compilers like.
constexpr int deepest = 40;

}  // namespace

FormulaText::FormulaText(const ExpressionGraph& graph, const std::vector<Node>& results, bool one_side)
    : graph_(graph), results_(results), one_side_(one_side), uses_(graph.size(), 0), depth_(graph.size(), 0) {
    for (const Node node : results)
        ++uses_[node];
    for (Node i = static_cast<Node>(graph_.size()); i-- > 0;) {
        if (uses_[i] == 0 || is_simple(i)) continue;
        ++uses_[graph_[i].a];
        if (is_binary(graph_[i].operation)) ++uses_[graph_[i].b];
    }
    for (Node i = 0; i < graph_.size(); ++i) {
        if (uses_[i] == 0 || is_simple(i)) continue;
        depth_[i] = 1 + std::max(depth_in(graph_[i].a), is_binary(graph_[i].operation) ? depth_in(graph_[i].b) : 0);
    }
}

std::string FormulaText::definitions() const {
    std::string text =
        "        using std::abs, std::sqrt, std::exp, std::log, std::pow;\n"
        "        using std::sin, std::cos, std::tan, std::asin, std::acos, std::atan;\n"
        "        using std::sinh, std::cosh, std::tanh;\n";
    for (Node i = 0; i < graph_.size(); ++i)
        if (uses_[i] > 0 && is_named(i)) text += fmt::format("        const T n{} = {};\n", i, formula(i));
    return text;
}
/// All results beside each other.
std::string FormulaText::list() const {
    std::string text;
    for (std::size_t i = 0; i < results_.size(); ++i)
        text += (i > 0 ? ", " : "") + result(i);
    return text;
}

bool FormulaText::is_simple(Node node) const {
    return graph_[node].operation == Operation::number || is_variable(graph_[node].operation);
}
bool FormulaText::is_named(Node node) const {
    return !is_simple(node) && (uses_[node] > 1 || depth_[node] > deepest);
}
/// Levels of brackets that an operand adds.
int FormulaText::depth_in(Node node) const {
    return is_simple(node) || is_named(node) ? 0 : depth_[node];
}

std::string FormulaText::operand(Node node) const {
    const auto& entry = graph_[node];
    switch (entry.operation) {
        case Operation::number:
            return fmt::format("T({:a})", entry.value);
        case Operation::parameter:
            return fmt::format("p[{}]", entry.index);
        case Operation::coordinate:
            return fmt::format("x[{}]", entry.index);
        case Operation::phase:
            return "phase";
        case Operation::input:
            return fmt::format("u[{}]", entry.index);
        case Operation::side:
            return fmt::format("T({})", side(entry.index));
        case Operation::constant:
            return fmt::format("c[{}]", entry.index);
        case Operation::forcing:
            return "force";
        default:
            return is_named(node) ? fmt::format("n{}", node) : fmt::format("({})", formula(node));
    }
}
std::string FormulaText::side(std::size_t index) const {
    return one_side_ ? "side" : fmt::format("side[{}]", index);
}
/// As an operand beside one of type T: numbers and sides as they are.
std::string FormulaText::beside(Node node, Node other) const {
    const auto& entry = graph_[node];
    const auto type = graph_[other].operation;
    if (entry.operation == Operation::number) return fmt::format("({:a})", entry.value);
    return entry.operation == Operation::side && type != Operation::side && type != Operation::number
               ? side(entry.index)
               : operand(node);
}
std::string FormulaText::formula(Node node) const {
    const auto& entry = graph_[node];
    const auto between = [&](char symbol) {
        const bool product = entry.operation == Operation::multiply;
        const auto text = [&](Node one, Node other) {
            const bool plain = graph_[one].operation == Operation::number || product;
            return plain ? beside(one, other) : operand(one);
        };
        return fmt::format("{} {} {}", text(entry.a, entry.b), symbol, text(entry.b, entry.a));
    };
    switch (entry.operation) {
        case Operation::add:
            return between('+');
        case Operation::subtract:
            return between('-');
        case Operation::multiply:
            return between('*');
        case Operation::divide:
            return between('/');
        case Operation::power:
            return fmt::format("pow({}, {})", operand(entry.a),
                               graph_[entry.b].operation == Operation::number
                                   ? fmt::format("{:a}", graph_[entry.b].value)
                                   : operand(entry.b));
        case Operation::negate:
            return fmt::format("-{}", operand(entry.a));
        case Operation::sign:
            return fmt::format("detail::sign_of({})", operand(entry.a));
        default:
            return fmt::format("{}({})", name_of_function(entry.operation), operand(entry.a));
    }
}

}  // namespace orbid::models
