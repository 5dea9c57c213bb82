#pragma once

#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/formulas/formula_operation.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// A text that is not an expression. `position` counts characters from 0; what() says what was expected there.
class ExpressionError : public std::invalid_argument {
public:
    ExpressionError(const std::string& message, std::size_t position_)
        : std::invalid_argument(message), position(position_) {}
    std::size_t position;
};

/// A formula in named quantities, as in "k2 / (m * l^2)": parsed once, evaluated on any scalar.
///
///     sum     = product { (+ | -) product }           left to right
///     product = signed { (* | /) signed }             left to right
///     signed  = { + | - } power                       -2^2 = -4
///     power   = atom [ ^ signed ]                     right to left: 2^3^2 = 512, 2^-1 = 0.5
///     atom    = number | pi | name | function ( sum ) | ( sum )
///
/// Functions: sin cos tan asin acos atan sinh cosh tanh exp log (natural) sqrt abs sign. pi and the functions are
/// reserved words: a name of the given list never hides them. Where the formula has no value (log of a negative number,
/// division by zero) it evaluates to nan or an infinity; nothing is thrown.
class Expression {
public:
    /// Longer texts are refused. Formulas written by a person are a hundredth of that, and it bounds what is built from
    /// them.
    static constexpr std::size_t longest_text = 20000;

    /// @param names  the quantities that may occur, in the order of the values given to evaluate().
    /// @throws ExpressionError naming the character where the text stops making sense, and for a name not in the
    ///         list.
    [[nodiscard]] static Expression parse(std::string_view text, std::span<const std::string> names);

    /// The text it was parsed from.
    [[nodiscard]] const std::string& text() const { return text_; }

    /// Indices of the names that occur, ascending, without duplicates.
    [[nodiscard]] const std::vector<std::size_t>& used() const { return used_; }

    /// Value at the given quantities, for any scalar with + - * / pow and the functions above found by its own
    /// namespace (double, dual numbers).
    template <class T>
    [[nodiscard]] T evaluate(std::span<const T> values) const {
        std::vector<T> stack;
        return evaluate(values, stack);
    }
    /// The same on a stack that is reused between evaluations; its content does not matter.
    template <class T>
    [[nodiscard]] T evaluate(std::span<const T> values, std::vector<T>& stack) const;

    [[nodiscard]] double value(const Eigen::VectorXd& values) const;

    /// Exact gradient by forward derivatives, shape as values. At x = 0 the derivative of abs is 1, that of sign 0.
    [[nodiscard]] Eigen::VectorXd gradient(const Eigen::VectorXd& values) const;

    using Operation = FormulaOperation;
    /// One step of the program: postfix notation on a stack.
    struct Step {
        Operation operation;
        double constant = 0.0;     ///< of `number`
        std::size_t index = 0;     ///< of `parameter`: which of the names
        std::size_t position = 0;  ///< character of the text at which it stands (of a function: its name), from 0
    };
    [[nodiscard]] const std::vector<Step>& steps() const { return steps_; }

private:
    std::string text_;
    std::vector<Step> steps_;
    std::vector<std::size_t> used_;
};

/// pi, or the name of a function: no quantity can be called so.
[[nodiscard]] bool is_reserved_word(std::string_view word);

template <class T>
T Expression::evaluate(std::span<const T> values, std::vector<T>& stack) const {
    stack.clear();
    stack.reserve(steps_.size());
    for (const Step& step : steps_) {
        if (step.operation == Operation::number) {
            stack.push_back(T(step.constant));
        } else if (step.operation == Operation::parameter) {
            stack.push_back(values[step.index]);
        } else if (is_binary(step.operation)) {
            const T right = stack.back();
            stack.pop_back();
            stack.back() = value_of_operation(step.operation, stack.back(), right);
        } else {
            stack.back() = value_of_operation(step.operation, stack.back());
        }
    }
    return stack.back();
}

}  // namespace orbid::models

#pragma GCC visibility pop
