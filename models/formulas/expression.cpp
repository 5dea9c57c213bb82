#include "models/formulas/expression.hpp"

#include <algorithm>
#include <charconv>
#include <numbers>
#include <utility>

#include "models/arithmetic/dual.hpp"

namespace orbid::models {

namespace {

/// Of an unknown name's neighbours.
constexpr std::size_t most_names_told = 12;

using Step = Expression::Step;

// The parser is recursive in brackets and signs; a formula that nests deeper than this is a mistake or an attack on the
// stack.
constexpr int deepest_nesting = 200;

bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}
bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/// Recursive descent over the grammar in the header; every function leaves its value on top of the stack.
class Parser {
public:
    Parser(std::string_view text, std::span<const std::string> names) : text_(text), names_(names) {}

    std::vector<Step> parse() {
        if (text_.size() > Expression::longest_text) {
            throw ExpressionError("a formula of " + std::to_string(text_.size()) + " characters: at most " +
                                      std::to_string(Expression::longest_text) + " are read",
                                  Expression::longest_text);
        }
        sum();
        if (peek() != '\0') fail(begins_atom(peek()) ? missing_operator : "expected an operator or the end");
        return std::move(steps_);
    }

private:
    void sum() { chain(&Parser::product, '+', FormulaOperation::add, '-', FormulaOperation::subtract); }
    void product() { chain(&Parser::negated, '*', FormulaOperation::multiply, '/', FormulaOperation::divide); }
    /// operand { (first | second) operand }, left to right.
    void chain(void (Parser::*operand)(), char first, FormulaOperation one, char second, FormulaOperation other) {
        (this->*operand)();
        for (char found = peek(); found == first || found == second; found = peek()) {
            const std::size_t at = position_++;
            (this->*operand)();
            push(found == first ? one : other, at);
        }
    }

    void negated() {
        if (++nesting_ > deepest_nesting) fail("nested too deeply");
        if (take('-')) {
            const std::size_t at = position_ - 1;
            negated();
            push(FormulaOperation::negate, at);
        } else if (take('+')) {
            negated();
        } else {
            power();
        }
        --nesting_;
    }

    void power() {
        atom();
        if (!take('^')) return;
        const std::size_t at = position_ - 1;
        negated();
        push(FormulaOperation::power, at);
    }

    void atom() {
        const char first = peek();
        const std::size_t start = position_;
        if (is_digit(first) || first == '.') return number();
        if (take('(')) return bracket(start);
        if (!is_letter(first)) fail("expected a number, a name or \"(\"");
        while (position_ < text_.size() && (is_letter(text_[position_]) || is_digit(text_[position_])))
            ++position_;
        const std::string_view word = text_.substr(start, position_ - start);
        if (word == "pi") {
            steps_.push_back({FormulaOperation::number, std::numbers::pi, 0, start});
            return;
        }
        const auto function = std::find(formula_functions.begin(), formula_functions.end(), word);
        if (function != formula_functions.end()) {
            const std::size_t open = position_;
            if (!take('(')) fail("expected \"(\" after " + std::string(word));
            bracket(open);
            push(formula_function(static_cast<std::size_t>(function - formula_functions.begin())), start);
            return;
        }
        const auto at = std::find(names_.begin(), names_.end(), word);
        if (at == names_.end()) {
            position_ = start;
            std::string known;
            for (std::size_t i = 0; i < std::min(names_.size(), most_names_told); ++i)
                known += (i > 0 ? ", " : "; known: ") + std::string(names_[i]);
            if (names_.size() > most_names_told) known += " and more";
            refuse("unknown name \"" + std::string(word) + "\"" + known);
        }
        steps_.push_back({FormulaOperation::parameter, 0.0, static_cast<std::size_t>(at - names_.begin()), start});
    }

    void bracket(std::size_t open) {
        sum();
        if (take(')')) return;
        fail((begins_atom(peek()) ? missing_operator : "expected an operator or the \")\" of character ") +
             (begins_atom(peek()) ? "" : std::to_string(open + 1)));
    }

    void number() {
        double value = 0.0;
        const char* begin = text_.data() + position_;
        const auto [end, error] = std::from_chars(begin, text_.data() + text_.size(), value);
        if (error == std::errc::result_out_of_range) fail("number out of range");
        if (error != std::errc()) fail("expected a number");
        steps_.push_back({FormulaOperation::number, value, 0, position_});
        position_ += static_cast<std::size_t>(end - begin);
    }

    void push(FormulaOperation operation, std::size_t position) { steps_.push_back({operation, 0.0, 0, position}); }

    /// What may follow a value only after an operator: a product written as in a book, "k x" or "2(x + 1)".
    static bool begins_atom(char c) { return is_letter(c) || is_digit(c) || c == '('; }
    static constexpr const char* missing_operator = "expected an operator (a product is written with *)";

    /// The next character that is no blank, '\0' at the end.
    char peek() {
        while (position_ < text_.size() && (text_[position_] == ' ' || text_[position_] == '\t'))
            ++position_;
        return position_ < text_.size() ? text_[position_] : '\0';
    }

    bool take(char wanted) {
        if (peek() != wanted) return false;
        ++position_;
        return true;
    }

    [[noreturn]] void fail(const std::string& rule) {
        peek();
        std::string found = position_ < text_.size() ? "\"" + std::string(1, text_[position_]) + "\"" : "the end";
        refuse(rule + ", found " + found);
    }
    [[noreturn]] void refuse(const std::string& rule) {
        throw ExpressionError("character " + std::to_string(position_ + 1) + " of \"" + excerpt() + "\": " + rule,
                              position_);
    }

    /// The text, of a long one what stands around the position: a message stays readable.
    [[nodiscard]] std::string excerpt() const {
        constexpr std::size_t longest = 120, before = 60;
        if (text_.size() <= longest) return std::string(text_);
        const std::size_t from = position_ > before ? position_ - before : 0;
        return (from > 0 ? "..." : "") + std::string(text_.substr(from, longest)) +
               (from + longest < text_.size() ? "..." : "");
    }

    std::string_view text_;
    std::span<const std::string> names_;
    std::size_t position_ = 0;
    int nesting_ = 0;
    std::vector<Step> steps_;
};

}  // namespace

Expression Expression::parse(std::string_view text, std::span<const std::string> names) {
    Expression result;
    result.text_ = text;
    result.steps_ = Parser(text, names).parse();
    for (const Step& step : result.steps_) {
        if (step.operation == FormulaOperation::parameter) result.used_.push_back(step.index);
    }
    std::sort(result.used_.begin(), result.used_.end());
    result.used_.erase(std::unique(result.used_.begin(), result.used_.end()), result.used_.end());
    return result;
}

bool is_reserved_word(std::string_view word) {
    return word == "pi" || std::count(formula_functions.begin(), formula_functions.end(), word) > 0;
}

double Expression::value(const Eigen::VectorXd& values) const {
    return evaluate(std::span<const double>(values.data(), static_cast<std::size_t>(values.size())));
}

Eigen::VectorXd Expression::gradient(const Eigen::VectorXd& values) const {
    // One direction at a time: formulas of a job use a few names and are evaluated a few times per run.
    using Scalar = Dual<1>;
    std::vector<Scalar> point(values.data(), values.data() + values.size());
    Eigen::VectorXd result = Eigen::VectorXd::Zero(values.size());
    for (const std::size_t index : used_) {
        const auto i = static_cast<Eigen::Index>(index);
        point[index] = Scalar::variable(values[i], 0);
        result[i] = evaluate(std::span<const Scalar>(point)).partial[0];
        point[index] = Scalar(values[i]);
    }
    return result;
}

}  // namespace orbid::models
