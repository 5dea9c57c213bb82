#include "models/equations/equation_program.hpp"

#include <algorithm>
#include <functional>
#include <queue>
#include <stdexcept>
#include <utility>

namespace orbid::models {

namespace {

using GraphOperation = ExpressionGraph::Operation;
using CodeOperation = FormulaCode::Operation;
using Node = ExpressionGraph::Node;

CodeOperation function_of(GraphOperation operation) {
    // Both lists end with the functions, in the same order.
    return static_cast<CodeOperation>(static_cast<int>(CodeOperation::negate) + static_cast<int>(operation) -
                                      static_cast<int>(GraphOperation::negate));
}
static_assert(static_cast<int>(CodeOperation::sign) - static_cast<int>(CodeOperation::negate) ==
              static_cast<int>(GraphOperation::sign) - static_cast<int>(GraphOperation::negate));

FormulaCode::Segment segment_of(GraphOperation operation) {
    switch (operation) {
        case GraphOperation::parameter:
        case GraphOperation::coordinate:
            return FormulaCode::coordinates;
        case GraphOperation::constant:
            return FormulaCode::constants;
        case GraphOperation::phase:
        case GraphOperation::forcing:
            return FormulaCode::forcing;
        case GraphOperation::input:
            return FormulaCode::inputs;
        default:
            return FormulaCode::registers;
    }
}

}  // namespace

FormulaCode formula_code(const ExpressionGraph& graph, std::span<const Node> results,
                         std::span<const std::size_t> places) {
    using Operand = FormulaCode::Operand;
    constexpr auto registers = FormulaCode::registers;
    std::vector<FormulaCode::Instruction> instructions;
    std::size_t register_count = 0;
    std::vector<bool> needed(graph.size(), false), wanted(graph.size(), false);
    for (const Node node : results)
        needed[node] = wanted[node] = true;
    // Numbers and sides are operands of most operations; only where an operation has none for them they get registers.
    std::vector<bool> loaded(graph.size(), false);
    const auto is_number = [&](Node node) { return graph[node].operation == GraphOperation::number; };
    const auto is_side = [&](Node node) { return graph[node].operation == GraphOperation::side; };
    std::vector<Node> last_use(graph.size(), 0);
    const auto uses = [&](Node by, Node operand) {
        needed[operand] = true;
        last_use[operand] = std::max(last_use[operand], by);
    };
    for (Node i = static_cast<Node>(graph.size()); i-- > 0;) {
        if (!needed[i]) continue;
        const auto& entry = graph[i];
        if (is_unary(entry.operation)) uses(i, entry.a);
        if (!is_binary(entry.operation)) continue;
        uses(i, entry.a);
        uses(i, entry.b);
        const bool product = entry.operation == GraphOperation::multiply;
        if (is_number(entry.a) && entry.operation == GraphOperation::power) loaded[entry.a] = true;
        // A side is an operand of its own in products with what is neither side nor number.
        for (const auto& [one, other] : {std::pair(entry.a, entry.b), std::pair(entry.b, entry.a)})
            if (is_side(one) && !(product && !is_side(other) && !is_number(other))) loaded[one] = true;
    }
    for (Node i = 0; i < graph.size(); ++i) {
        if (wanted[i]) loaded[i] = true;
        if (needed[i] && is_unary(graph[i].operation) && is_side(graph[i].a)) loaded[graph[i].a] = true;
    }

    std::vector<Operand> place(graph.size());
    std::priority_queue<std::uint16_t, std::vector<std::uint16_t>, std::greater<>> free;
    const auto release = [&](Node operand, Node by) {
        const bool temporary = place[operand].segment == registers && !is_variable(graph[operand].operation);
        if (temporary && !wanted[operand] && last_use[operand] == by && !is_number(operand))
            free.push(place[operand].index);
    };
    const auto target = [&] {
        if (!free.empty()) {
            const std::uint16_t index = free.top();
            free.pop();
            return index;
        }
        if (register_count >= FormulaCode::most_registers)
            throw std::length_error("the formulas need more intermediate results at a time than can be held");
        return static_cast<std::uint16_t>(register_count++);
    };
    const auto emit = [&](Node node, CodeOperation operation, Operand a, Operand b, double literal) {
        const std::uint16_t to = target();
        place[node] = {registers, to};
        instructions.push_back({operation, a, b, to, literal});
    };
    for (Node i = 0; i < graph.size(); ++i) {
        if (!needed[i]) continue;
        const auto& entry = graph[i];
        if (entry.operation == GraphOperation::number) {
            if (loaded[i]) emit(i, CodeOperation::number, {}, {}, entry.value);
        } else if (entry.operation == GraphOperation::side) {
            if (loaded[i]) emit(i, CodeOperation::side, {}, {registers, static_cast<std::uint16_t>(entry.index)}, 0.0);
        } else if (is_variable(entry.operation)) {
            const bool moved = entry.operation == GraphOperation::parameter && !places.empty();
            place[i] = {segment_of(entry.operation),
                        static_cast<std::uint16_t>(moved ? places[entry.index] : entry.index)};
        } else if (is_unary(entry.operation)) {
            // Results are written while operands are read, so a register is freed only afterwards.
            emit(i, function_of(entry.operation), place[entry.a], {}, 0.0);
            release(entry.a, i);
        } else {
            const Operand a = place[entry.a], b = place[entry.b];
            const bool left = is_number(entry.a) && !loaded[entry.a], right = is_number(entry.b) && !loaded[entry.b];
            const double x = graph[entry.a].value, y = graph[entry.b].value;
            const auto side_operand = [&](Node side) {
                return Operand{registers, static_cast<std::uint16_t>(graph[side].index)};
            };
            switch (entry.operation) {
                case GraphOperation::add:
                    if (left || right)
                        emit(i, CodeOperation::add_number, left ? b : a, {}, left ? x : y);
                    else
                        emit(i, CodeOperation::add, a, b, 0.0);
                    break;
                case GraphOperation::subtract:
                    if (left)
                        emit(i, CodeOperation::from_number, b, {}, x);
                    else if (right)
                        emit(i, CodeOperation::add_number, a, {}, -y);
                    else
                        emit(i, CodeOperation::subtract, a, b, 0.0);
                    break;
                case GraphOperation::multiply:
                    if (left || right)
                        emit(i, CodeOperation::multiply_number, left ? b : a, {}, left ? x : y);
                    else if (is_side(entry.a) && !loaded[entry.a])
                        emit(i, CodeOperation::multiply_side, b, side_operand(entry.a), 0.0);
                    else if (is_side(entry.b) && !loaded[entry.b])
                        emit(i, CodeOperation::multiply_side, a, side_operand(entry.b), 0.0);
                    else
                        emit(i, CodeOperation::multiply, a, b, 0.0);
                    break;
                case GraphOperation::divide:
                    if (left)
                        emit(i, CodeOperation::number_over, b, {}, x);
                    else if (right)
                        emit(i, CodeOperation::over_number, a, {}, y);
                    else
                        emit(i, CodeOperation::divide, a, b, 0.0);
                    break;
                default:  // power
                    if (right)
                        emit(i, CodeOperation::power_number, a, {}, y);
                    else
                        emit(i, CodeOperation::power, a, b, 0.0);
                    break;
            }
            release(entry.a, i);
            if (entry.b != entry.a) release(entry.b, i);
        }
    }
    std::vector<Operand> places_of_results;
    for (const Node node : results)
        places_of_results.push_back(place[node]);
    return {std::move(instructions), std::move(places_of_results), register_count};
}

EquationProgram equation_program(const Equations& equations, std::span<const std::size_t> places) {
    EquationProgram program;
    program.surface_count = equations.surfaces().size();
    program.coordinate_count = equations.rates().size();

    // General surfaces are functions of the phase itself.
    const bool tabulated = equations.surfaces().empty() || equations.dry_friction();
    StagedEquations stages = staged(equations, EquationProgram::most_constants, tabulated);
    program.constant_count = stages.constants.size();
    program.constants = formula_code(stages.graph, stages.constants, places);
    const Node phase = stages.graph.variable(GraphOperation::phase, 0);
    const Node force = stages.forcing.value_or(phase);
    program.forcing = formula_code(stages.graph, std::span(&force, 1));
    program.rates = formula_code(stages.graph, stages.rates);
    program.surfaces = formula_code(stages.graph, stages.surfaces);

    const auto entry_of = [&](std::size_t rate, Node variable) {
        const auto& entry = stages.graph[variable];
        return EquationProgram::Entry{rate, segment_of(entry.operation), entry.index};
    };
    std::vector<Node> results = stages.rates;
    for (const auto& [rate, variable, derivative] : stages.derivatives()) {
        program.entries.push_back(entry_of(rate, variable));
        results.push_back(derivative);
    }
    program.linearised = formula_code(stages.graph, results);

    results.assign(1, force);
    std::vector<Node> variables{phase};
    for (std::size_t k = 0; k < program.constant_count; ++k)
        variables.push_back(stages.graph.variable(GraphOperation::constant, k));
    for (const Node variable : variables) {
        if (const auto derivative = stages.graph.derivative(force, variable)) {
            program.forcing_entries.push_back(entry_of(0, variable));
            results.push_back(*derivative);
        }
    }
    program.linearised_forcing = formula_code(stages.graph, results);
    return program;
}

}  // namespace orbid::models
