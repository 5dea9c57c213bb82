#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

/// each(sin) each(cos) ...: the functions of formulas that the standard library has too. Their lists are made by it.
#define ORBID_FORMULA_FUNCTIONS(each)                                                                         \
    each(sin) each(cos) each(tan) each(asin) each(acos) each(atan) each(sinh) each(cosh) each(tanh) each(exp) \
        each(log) each(sqrt) each(abs)

namespace orbid::models {

/// What formulas consist of: as text, as a graph, as instructions.
enum class FormulaOperation : std::uint8_t {
    number,      ///< literal
    parameter,   ///< a name of a formula; of a model's equations: a parameter
    coordinate,  ///< of the state
    phase,       ///< of the forcing
    input,       ///< measured
    side,        ///< +1 or -1, of a switching surface
    constant,    ///< computed from the parameters once per flow
    forcing,     ///< the one number through which the phase enters
    add,
    subtract,
    multiply,
    divide,
    power,  ///< general
    negate,
    sign,
#define ORBID_FORMULA_FUNCTION(function) function,
    ORBID_FORMULA_FUNCTIONS(ORBID_FORMULA_FUNCTION)
#undef ORBID_FORMULA_FUNCTION
    // Instructions with a number or a side as operand.
    add_number,   ///< a + literal
    from_number,  ///< literal - a
    multiply_number,
    over_number,   ///< a / literal
    number_over,   ///< literal / a
    power_number,  ///< a ^ literal
    multiply_side  ///< side of surface b times a
};

/// A variable: no operation on others.
[[nodiscard]] constexpr bool is_variable(FormulaOperation operation) {
    return operation != FormulaOperation::number && operation < FormulaOperation::add;
}
/// An operation on two operands.
[[nodiscard]] constexpr bool is_binary(FormulaOperation operation) {
    return operation >= FormulaOperation::add && operation <= FormulaOperation::power;
}
/// An operation on one operand: negate or a function.
[[nodiscard]] constexpr bool is_unary(FormulaOperation operation) {
    return operation >= FormulaOperation::negate && operation < FormulaOperation::add_number;
}

/// Names of the functions, in the order of FormulaOperation.
inline constexpr std::array formula_functions{std::string_view("sign"),
#define ORBID_FORMULA_FUNCTION(function) std::string_view(#function),
                                              ORBID_FORMULA_FUNCTIONS(ORBID_FORMULA_FUNCTION)
#undef ORBID_FORMULA_FUNCTION
};
[[nodiscard]] constexpr FormulaOperation formula_function(std::size_t i) {
    return static_cast<FormulaOperation>(static_cast<std::size_t>(FormulaOperation::sign) + i);
}
[[nodiscard]] constexpr std::string_view name_of_function(FormulaOperation operation) {
    return formula_functions[static_cast<std::size_t>(operation) - static_cast<std::size_t>(FormulaOperation::sign)];
}

/// The result of an operation on two operands.
template <class T>
[[nodiscard]] T value_of_operation(FormulaOperation operation, const T& a, const T& b) {
    using std::pow;
    switch (operation) {
        case FormulaOperation::add:
            return a + b;
        case FormulaOperation::subtract:
            return a - b;
        case FormulaOperation::multiply:
            return a * b;
        case FormulaOperation::divide:
            return a / b;
        default:
            return pow(a, b);
    }
}
/// The same of an operation on one.
template <class T>
[[nodiscard]] T value_of_operation(FormulaOperation operation, const T& a) {
    using std::abs, std::sqrt, std::exp, std::log;
    using std::sin, std::cos, std::tan, std::asin, std::acos, std::atan, std::sinh, std::cosh, std::tanh;
    switch (operation) {
        case FormulaOperation::negate:
            return -a;
#define ORBID_FORMULA_FUNCTION(function) \
    case FormulaOperation::function:     \
        return function(a);
            ORBID_FORMULA_FUNCTIONS(ORBID_FORMULA_FUNCTION)
#undef ORBID_FORMULA_FUNCTION
        // nan stays nan: a - a is 0 for finite numbers only.
        default:
            return a > T(0.0) ? T(1.0) : a < T(0.0) ? T(-1.0) : T(a - a);
    }
}

}  // namespace orbid::models
