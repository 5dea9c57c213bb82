#include "models/equations/equations.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "models/equations/equation_reader.hpp"

namespace orbid::models {

std::shared_ptr<const Equations> Equations::read(const EquationText& text, std::vector<EquationProblem>& problems) {
    return EquationReader(text, problems).read();
}

Kind Equations::kind() const {
    return text_.map ? Kind::map : text_.forcing ? Kind::forced : Kind::autonomous;
}

double Equations::evaluation_cost() const {
    constexpr double function = 10.0, lorenz = 14.0;
    // What stands for the sides of surfaces is in the graph too.
    std::vector<bool> needed(graph_.size());
    for (const Node node : rates_)
        needed[node] = true;
    double cost = 0.0;
    for (std::size_t i = graph_.size(); i-- > 0;) {
        if (!needed[i]) continue;
        const ExpressionGraph::Entry& entry = graph_[static_cast<Node>(i)];
        const bool variable = entry.operation < FormulaOperation::add;
        if (!variable) needed[entry.a] = true;
        if (is_binary(entry.operation)) needed[entry.b] = true;
        const bool simple = entry.operation < FormulaOperation::sign && entry.operation != FormulaOperation::power;
        cost += simple ? 1.0 : function;
    }
    return std::max(1.0, cost / lorenz);
}

bool Equations::smooth(const double* theta) const {
    // Two formulas that agree at numbers without a pattern are the same: three of them leave no doubt.
    for (std::size_t trial = 0; trial < 3; ++trial) {
        for (const auto& surface : on_surface_) {
            for (const auto& [above, below] : surface) {
                const std::vector<Node> both{above, below};
                const auto f = graph_.values(both, [&](const ExpressionGraph::Entry& entry) {
                    switch (entry.operation) {
                        case ExpressionGraph::Operation::parameter:
                            return theta[entry.index];
                        case ExpressionGraph::Operation::side:
                            return 1.0;
                        default: {
                            // Multiples of the square root of 2, modulo 1.
                            const double x = static_cast<double>(3 * trial + entry.index + 1) * 1.4142135623730951;
                            return x - std::floor(x) + 0.1;
                        }
                    }
                });
                if (f[0] != f[1]) return false;
            }
        }
    }
    return true;
}

}  // namespace orbid::models
