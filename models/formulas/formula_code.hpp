#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "models/arithmetic/dual.hpp"
#include "models/formulas/formula_operation.hpp"

namespace orbid::models {

/// Formulas as a list of instructions on registers. They run in the arithmetic of any scalar of the project: double,
/// dual numbers of both orders, packs. Const and thread-safe.
class FormulaCode {
public:
    /// Where an operand is stored: results so far, or one of the arrays of variables.
    enum Segment : std::uint8_t { registers, coordinates, constants, forcing, inputs, segment_count };
    struct Operand {
        std::uint8_t segment = registers;
        std::uint16_t index = 0;
    };
    using Operation = FormulaOperation;
    struct Instruction {
        Operation operation;
        Operand a, b;
        std::uint16_t to;
        double literal;
    };
    /// Room for the results that are needed at the same time.
    static constexpr std::size_t most_registers = 400;

    FormulaCode() = default;
    FormulaCode(std::vector<Instruction> instructions, std::vector<Operand> results, std::size_t register_count)
        : instructions_(std::move(instructions)), results_(std::move(results)), register_count_(register_count) {}

    [[nodiscard]] const std::vector<Instruction>& instructions() const { return instructions_; }
    [[nodiscard]] std::size_t register_count() const { return register_count_; }

    /// Carries out all instructions.
    /// @param given  arrays of the variables by segment; that of the registers has room for register_count()
    /// @param sides  of the switching surfaces: plain numbers, or of the scalar
    template <class T, class S>
    void run(const std::array<T*, segment_count>& given, const S* sides) const;

    /// One of the results, after run().
    template <class T>
    [[nodiscard]] const T& result(const std::array<T*, segment_count>& given, std::size_t i) const {
        return given[results_[i].segment][results_[i].index];
    }

private:
    std::vector<Instruction> instructions_;
    std::vector<Operand> results_;
    std::size_t register_count_ = 0;
};

namespace detail {
/// sign of a number, with no derivative; nan stays nan.
template <class T>
T sign_of(const T& x) {
    if constexpr (requires {
                      { value_of(x) } -> std::convertible_to<double>;
                  }) {
        const double value = value_of(x);
        return T(value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : value - value);
    } else if constexpr (requires { x.value; }) {
        return T(sign_of(x.value));
    } else {
        return select(x > T(0.0), T(1.0), select(x < T(0.0), T(-1.0), x - x));
    }
}
}  // namespace detail

template <class T, class S>
[[gnu::noinline]] void FormulaCode::run(const std::array<T*, segment_count>& given, const S* sides) const {
    using std::abs, std::sqrt, std::exp, std::log, std::pow;
    using std::sin, std::cos, std::tan, std::asin, std::acos, std::atan, std::sinh, std::cosh, std::tanh;
    T* const results = given[registers];
    for (const Instruction& step : instructions_) {
        const T& a = given[step.a.segment][step.a.index];
        const T& b = given[step.b.segment][step.b.index];
        T& to = results[step.to];
        switch (step.operation) {
#define ORBID_INSTRUCTION(operation, value) \
    case Operation::operation:              \
        to = value;                         \
        break
            ORBID_INSTRUCTION(number, T(step.literal));
            ORBID_INSTRUCTION(side, T(sides[step.b.index]));
            ORBID_INSTRUCTION(add, a + b);
            ORBID_INSTRUCTION(subtract, a - b);
            ORBID_INSTRUCTION(multiply, a * b);
            ORBID_INSTRUCTION(divide, a / b);
            ORBID_INSTRUCTION(power, pow(a, b));
            ORBID_INSTRUCTION(add_number, a + step.literal);
            ORBID_INSTRUCTION(from_number, step.literal - a);
            ORBID_INSTRUCTION(multiply_number, step.literal * a);
            ORBID_INSTRUCTION(over_number, a / step.literal);
            ORBID_INSTRUCTION(number_over, step.literal / a);
            ORBID_INSTRUCTION(power_number, pow(a, step.literal));
            ORBID_INSTRUCTION(multiply_side, T(sides[step.b.index] * a));
            ORBID_INSTRUCTION(negate, -a);
            ORBID_INSTRUCTION(sign, detail::sign_of(a));
#define ORBID_FUNCTION_INSTRUCTION(function) ORBID_INSTRUCTION(function, function(a));
            ORBID_FORMULA_FUNCTIONS(ORBID_FUNCTION_INSTRUCTION)
#undef ORBID_FUNCTION_INSTRUCTION
#undef ORBID_INSTRUCTION
            default:
                break;  // variables are operands
        }
    }
}

/// A model written as text, ready to be evaluated without a compiler.
struct EquationProgram {
    /// Constants of a flow; with the coordinates they are fewer than the 64 local variables of a LocalDual.
    static constexpr std::size_t most_constants = 40;
    static constexpr std::size_t most_parameters = 40;

    FormulaCode constants;  ///< of the parameters, which stand in the place of the coordinates
    FormulaCode forcing;    ///< of the phase, in the place of the forcing, and the constants
    FormulaCode rates;
    FormulaCode surfaces;
    std::size_t constant_count = 0;
    std::size_t surface_count = 0;
    std::size_t coordinate_count = 0;

    /// Rates, then their derivatives where they are not 0.
    FormulaCode linearised;
    /// By the forcing, then the constants.
    FormulaCode linearised_forcing;
    struct Entry {
        std::size_t rate;      ///< 0 of the forcing
        std::size_t segment;   ///< of the variable: FormulaCode::coordinates, constants or forcing
        std::size_t variable;  ///< its index there
    };
    std::vector<Entry> entries;          ///< of `linearised`: result coordinate_count + i
    std::vector<Entry> forcing_entries;  ///< of `linearised_forcing`: result 1 + i
};

}  // namespace orbid::models
