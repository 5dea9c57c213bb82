#include "models/equations/staged_equations.hpp"

#include <algorithm>
#include <map>

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Operation = ExpressionGraph::Operation;

/// What a node depends on, as a sum of bits.
enum Dependence : unsigned { on_parameters = 1, on_phase = 2, on_state = 4 };

std::vector<unsigned> dependences(const ExpressionGraph& graph) {
    std::vector<unsigned> result(graph.size(), 0);
    for (Node i = 0; i < graph.size(); ++i) {
        const auto& entry = graph[i];
        if (is_binary(entry.operation)) {
            result[i] = result[entry.a] | result[entry.b];
        } else if (is_unary(entry.operation)) {
            result[i] = result[entry.a];
        } else if (entry.operation == Operation::parameter || entry.operation == Operation::constant) {
            result[i] = on_parameters;
        } else if (entry.operation == Operation::phase) {
            result[i] = on_phase;
        } else if (entry.operation != Operation::number) {
            result[i] = on_state;
        }
    }
    return result;
}

/// The largest parts of the roots for which `belongs` holds, in the order of the graph.
template <class Belongs>
std::vector<Node> largest_parts(const ExpressionGraph& graph, const std::vector<Node>& roots, const Belongs& belongs) {
    std::vector<bool> needed(graph.size(), false);
    for (const Node root : roots)
        needed[root] = true;
    std::vector<Node> parts;
    for (Node i = static_cast<Node>(graph.size()); i-- > 0;) {
        if (!needed[i]) continue;
        if (belongs(i)) {
            parts.push_back(i);
            continue;
        }
        const auto& entry = graph[i];
        if (is_binary(entry.operation) || is_unary(entry.operation)) needed[entry.a] = true;
        if (is_binary(entry.operation)) needed[entry.b] = true;
    }
    std::reverse(parts.begin(), parts.end());
    return parts;
}

std::vector<Node> replaced_all(ExpressionGraph& graph, const std::vector<Node>& roots, const std::map<Node, Node>& by) {
    std::map<Node, Node> known = by;
    std::vector<Node> result;
    for (const Node root : roots)
        result.push_back(graph.replace(
            root, [](Node) { return std::nullopt; }, known));
    return result;
}

}  // namespace

StagedEquations staged(const Equations& equations, std::size_t most_constants, bool seek_forcing) {
    StagedEquations staged{equations.graph(), {}, std::nullopt, {}, {}};
    ExpressionGraph& graph = staged.graph;
    const std::size_t n = equations.rates().size();
    std::vector<Node> roots(equations.rates().begin(), equations.rates().end());
    roots.insert(roots.end(), equations.surfaces().begin(), equations.surfaces().end());

    const auto depends = dependences(graph);
    staged.constants = largest_parts(graph, roots, [&](Node i) { return depends[i] == on_parameters; });
    if (staged.constants.size() > most_constants)
        staged.constants =
            largest_parts(graph, roots, [&](Node i) { return graph[i].operation == Operation::parameter; });
    std::map<Node, Node> by;
    for (std::size_t k = 0; k < staged.constants.size(); ++k)
        by[staged.constants[k]] = graph.variable(Operation::constant, k);
    roots = replaced_all(graph, roots, by);

    if (seek_forcing && equations.kind() == Kind::forced) {
        // One number through which the phase enters, as large a part of the formulas as there is.
        const auto now = dependences(graph);
        const Node phase = graph.variable(Operation::phase, 0);
        for (Node i = static_cast<Node>(now.size()); i-- > 0 && !staged.forcing;) {
            if ((now[i] & on_phase) == 0 || (now[i] & on_state) != 0 || i == phase) continue;
            const bool occurs =
                std::any_of(roots.begin(), roots.end(), [&](Node root) { return graph.contains(root, i); });
            if (!occurs) continue;
            const auto others = replaced_all(graph, roots, {{i, graph.variable(Operation::forcing, 0)}});
            const bool all =
                std::none_of(others.begin(), others.end(), [&](Node root) { return graph.contains(root, phase); });
            if (!all) continue;
            staged.forcing = i;
            roots = others;
        }
    }
    staged.rates.assign(roots.begin(), roots.begin() + static_cast<std::ptrdiff_t>(n));
    staged.surfaces.assign(roots.begin() + static_cast<std::ptrdiff_t>(n), roots.end());
    return staged;
}

std::vector<StagedEquations::Derivative> StagedEquations::derivatives() {
    std::vector<Node> variables;
    for (std::size_t i = 0; i < rates.size(); ++i)
        variables.push_back(graph.variable(Operation::coordinate, i));
    for (std::size_t k = 0; k < constants.size(); ++k)
        variables.push_back(graph.variable(Operation::constant, k));
    variables.push_back(graph.variable(forcing ? Operation::forcing : Operation::phase, 0));
    std::vector<Derivative> result;
    for (std::size_t i = 0; i < rates.size(); ++i)
        for (const Node variable : variables)
            if (const auto derivative = graph.derivative(rates[i], variable))
                result.push_back({i, variable, *derivative});
    return result;
}

}  // namespace orbid::models
