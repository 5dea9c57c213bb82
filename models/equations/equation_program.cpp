#include "models/equations/equation_program.hpp"

#include <algorithm>
#include <functional>
#include <queue>
#include <stdexcept>
#include <utility>

namespace orbid::models {

namespace {

using Operation = FormulaOperation;
using Node = ExpressionGraph::Node;
using Operand = FormulaCode::Operand;

FormulaCode::Segment segment_of(Operation operation) {
    switch (operation) {
        case Operation::parameter:
        case Operation::coordinate:
            return FormulaCode::coordinates;
        case Operation::constant:
            return FormulaCode::constants;
        case Operation::phase:
        case Operation::forcing:
            return FormulaCode::forcing;
        case Operation::input:
            return FormulaCode::inputs;
        default:
            return FormulaCode::registers;
    }
}

/// Instructions for some nodes of a graph, in its order, on as few registers as that takes.
class CodeWriter {
public:
    CodeWriter(const ExpressionGraph& graph, std::span<const Node> results, std::span<const std::size_t> places)
        : graph_(graph),
          results_(results),
          places_(places),
          needed_(graph.size(), false),
          wanted_(graph.size(), false),
          loaded_(graph.size(), false),
          last_use_(graph.size(), 0),
          place_(graph.size()) {
        for (const Node node : results)
            needed_[node] = wanted_[node] = true;
        find_uses();
        find_loaded();
    }

    [[nodiscard]] FormulaCode code() {
        for (Node i = 0; i < graph_.size(); ++i)
            if (needed_[i]) write(i);
        std::vector<Operand> places_of_results;
        for (const Node node : results_)
            places_of_results.push_back(place_[node]);
        return {std::move(instructions_), std::move(places_of_results), register_count_};
    }

private:
    [[nodiscard]] bool is_number(Node node) const { return graph_[node].operation == Operation::number; }
    [[nodiscard]] bool is_side(Node node) const { return graph_[node].operation == Operation::side; }

    void find_uses() {
        const auto use = [&](Node by, Node operand) {
            needed_[operand] = true;
            last_use_[operand] = std::max(last_use_[operand], by);
        };
        for (Node i = static_cast<Node>(graph_.size()); i-- > 0;) {
            const auto& entry = graph_[i];
            if (!needed_[i] || !(is_unary(entry.operation) || is_binary(entry.operation))) continue;
            use(i, entry.a);
            if (is_binary(entry.operation)) use(i, entry.b);
        }
    }

    /// Numbers and sides are operands of most operations; only where an operation has none for them they get registers.
    void find_loaded() {
        for (Node i = 0; i < graph_.size(); ++i) {
            const auto& entry = graph_[i];
            if (wanted_[i]) loaded_[i] = true;
            if (!needed_[i]) continue;
            if (is_unary(entry.operation) && is_side(entry.a)) loaded_[entry.a] = true;
            if (!is_binary(entry.operation)) continue;
            if (is_number(entry.a) && entry.operation == Operation::power) loaded_[entry.a] = true;
            // A side is an operand of its own in products with what is neither side nor number.
            const bool product = entry.operation == Operation::multiply;
            for (const auto& [one, other] : {std::pair(entry.a, entry.b), std::pair(entry.b, entry.a)})
                if (is_side(one) && !(product && !is_side(other) && !is_number(other))) loaded_[one] = true;
        }
    }

    void write(Node i) {
        const auto& entry = graph_[i];
        if (entry.operation == Operation::number) {
            if (loaded_[i]) emit(i, Operation::number, {}, {}, entry.value);
        } else if (entry.operation == Operation::side) {
            if (loaded_[i]) emit(i, Operation::side, {}, side_operand(i));
        } else if (is_variable(entry.operation)) {
            const bool moved = entry.operation == Operation::parameter && !places_.empty();
            place_[i] = {segment_of(entry.operation),
                         static_cast<std::uint16_t>(moved ? places_[entry.index] : entry.index)};
        } else if (is_unary(entry.operation)) {
            // Results are written while operands are read, so a register is freed only afterwards.
            emit(i, entry.operation, place_[entry.a], {});
            release(entry.a, i);
        } else {
            write_binary(i);
            release(entry.a, i);
            if (entry.b != entry.a) release(entry.b, i);
        }
    }

    void write_binary(Node i) {
        const auto& entry = graph_[i];
        const Operand a = place_[entry.a], b = place_[entry.b];
        const double x = graph_[entry.a].value, y = graph_[entry.b].value;
        const bool left = is_number(entry.a) && !loaded_[entry.a], right = is_number(entry.b) && !loaded_[entry.b];
        const bool commutes = entry.operation == Operation::add || entry.operation == Operation::multiply;
        if (commutes && (left || right)) {
            const bool sum = entry.operation == Operation::add;
            return emit(i, sum ? Operation::add_number : Operation::multiply_number, left ? b : a, {}, left ? x : y);
        }
        switch (entry.operation) {
            case Operation::subtract:
                if (left) return emit(i, Operation::from_number, b, {}, x);
                if (right) return emit(i, Operation::add_number, a, {}, -y);
                break;
            case Operation::multiply:
                if (is_side(entry.a) && !loaded_[entry.a])
                    return emit(i, Operation::multiply_side, b, side_operand(entry.a));
                if (is_side(entry.b) && !loaded_[entry.b])
                    return emit(i, Operation::multiply_side, a, side_operand(entry.b));
                break;
            case Operation::divide:
                if (left) return emit(i, Operation::number_over, b, {}, x);
                if (right) return emit(i, Operation::over_number, a, {}, y);
                break;
            case Operation::power:
                if (right) return emit(i, Operation::power_number, a, {}, y);
                break;
            default:
                break;
        }
        emit(i, entry.operation, a, b);
    }

    [[nodiscard]] Operand side_operand(Node side) const {
        return {FormulaCode::registers, static_cast<std::uint16_t>(graph_[side].index)};
    }

    void emit(Node node, Operation operation, Operand a, Operand b, double literal = 0.0) {
        const std::uint16_t to = free_register();
        place_[node] = {FormulaCode::registers, to};
        instructions_.push_back({operation, a, b, to, literal});
    }

    std::uint16_t free_register() {
        if (!free_.empty()) {
            const std::uint16_t index = free_.top();
            free_.pop();
            return index;
        }
        if (register_count_ >= FormulaCode::most_registers)
            throw std::length_error("the formulas need more intermediate results at a time than can be held");
        return static_cast<std::uint16_t>(register_count_++);
    }

    void release(Node operand, Node by) {
        const bool temporary =
            place_[operand].segment == FormulaCode::registers && !is_variable(graph_[operand].operation);
        if (temporary && !wanted_[operand] && last_use_[operand] == by && !is_number(operand))
            free_.push(place_[operand].index);
    }

    const ExpressionGraph& graph_;
    std::span<const Node> results_;
    std::span<const std::size_t> places_;  ///< of the parameters
    std::vector<bool> needed_, wanted_;
    std::vector<bool> loaded_;  ///< numbers and sides in registers
    std::vector<Node> last_use_;
    std::vector<Operand> place_;
    std::priority_queue<std::uint16_t, std::vector<std::uint16_t>, std::greater<>> free_;
    std::vector<FormulaCode::Instruction> instructions_;
    std::size_t register_count_ = 0;
};

FormulaCode formula_code(const ExpressionGraph& graph, std::span<const Node> results,
                         std::span<const std::size_t> places = {}) {
    return CodeWriter(graph, results, places).code();
}

}  // namespace

EquationProgram equation_program(const Equations& equations, std::span<const std::size_t> places) {
    EquationProgram program;
    program.surface_count = equations.surfaces().size();
    program.coordinate_count = equations.rates().size();

    // General surfaces are functions of the phase itself.
    const bool tabulated = equations.surfaces().empty() || equations.dry_friction();
    StagedEquations stages = staged(equations, EquationProgram::most_constants, tabulated);
    program.constant_count = stages.constants.size();
    program.constants = formula_code(stages.graph, stages.constants, places);
    const Node phase = stages.graph.variable(Operation::phase, 0);
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
        variables.push_back(stages.graph.variable(Operation::constant, k));
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
