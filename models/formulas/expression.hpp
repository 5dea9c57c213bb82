#pragma once

#include <cmath>
#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

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

    /// One step of the program: postfix notation on a stack.
    enum class Operation {
        constant,
        name,
        add,
        subtract,
        multiply,
        divide,
        power,
        negate,
        sin,
        cos,
        tan,
        asin,
        acos,
        atan,
        sinh,
        cosh,
        tanh,
        exp,
        log,
        sqrt,
        abs,
        sign
    };
    struct Step {
        Operation operation;
        double constant = 0.0;     ///< of `constant`
        std::size_t index = 0;     ///< of `name`
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
    using std::abs, std::sqrt, std::exp, std::log, std::pow;
    using std::sin, std::cos, std::tan, std::asin, std::acos, std::atan, std::sinh, std::cosh, std::tanh;
    stack.clear();
    stack.reserve(steps_.size());
    for (const Step& step : steps_) {
        if (step.operation == Operation::constant) {
            stack.push_back(T(step.constant));
            continue;
        }
        if (step.operation == Operation::name) {
            stack.push_back(values[step.index]);
            continue;
        }
        T right = stack.back();
        stack.pop_back();
        const auto binary = [&](auto&& combine) {
            T left = stack.back();
            stack.pop_back();
            return T(combine(left, right));
        };
        T result(0.0);
        switch (step.operation) {
            case Operation::add:
                result = binary([](const T& a, const T& b) { return T(a + b); });
                break;
            case Operation::subtract:
                result = binary([](const T& a, const T& b) { return T(a - b); });
                break;
            case Operation::multiply:
                result = binary([](const T& a, const T& b) { return T(a * b); });
                break;
            case Operation::divide:
                result = binary([](const T& a, const T& b) { return T(a / b); });
                break;
            case Operation::power:
                result = binary([](const T& a, const T& b) { return T(pow(a, b)); });
                break;
            case Operation::negate:
                result = -right;
                break;
            case Operation::sin:
                result = sin(right);
                break;
            case Operation::cos:
                result = cos(right);
                break;
            case Operation::tan:
                result = tan(right);
                break;
            case Operation::asin:
                result = asin(right);
                break;
            case Operation::acos:
                result = acos(right);
                break;
            case Operation::atan:
                result = atan(right);
                break;
            case Operation::sinh:
                result = sinh(right);
                break;
            case Operation::cosh:
                result = cosh(right);
                break;
            case Operation::tanh:
                result = tanh(right);
                break;
            case Operation::exp:
                result = exp(right);
                break;
            case Operation::log:
                result = log(right);
                break;
            case Operation::sqrt:
                result = sqrt(right);
                break;
            case Operation::abs:
                result = abs(right);
                break;
            // nan stays nan: right - right is 0 for finite numbers only.
            case Operation::sign:
                result = right > T(0.0) ? T(1.0) : right < T(0.0) ? T(-1.0) : T(right - right);
                break;
            case Operation::constant:
            case Operation::name:
                break;  // handled above
        }
        stack.push_back(result);
    }
    return stack.back();
}

}  // namespace orbid::models

#pragma GCC visibility pop
