#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/equations/equation_reader.hpp"

namespace orbid::models {

// What a model written as text does beyond its formulas: where it jumps, and what it is symmetric under.

namespace {

using Node = ExpressionGraph::Node;
using Operation = ExpressionGraph::Operation;

/// Fractional parts of multiples of the golden ratio: numbers in (-1.5, 1.5) without a pattern, the same in every run.
double sample(std::size_t i) {
    const double x = static_cast<double>(i + 1) * 0.6180339887498949;
    return 3.0 * (x - std::floor(x)) - 1.5;
}

}  // namespace

bool EquationReader::moves(Node node) const {
    for (Node i = 0; i <= node; ++i) {
        const Operation operation = graph_[i].operation;
        const bool moving =
            operation == Operation::coordinate || operation == Operation::phase || operation == Operation::input;
        if (moving && graph_.contains(node, i)) return true;
    }
    return false;
}

void EquationReader::find_surfaces() {
    if (text_.switching && text_.map) {
        report(Part::model, 0, "a map has no switching surfaces: sign and abs are computed as they stand");
        return;
    }
    if (text_.map) return;
    std::vector<Node> arguments;  // of sign and abs, in the order of the formulas
    std::vector<bool> jumps;
    const Node end = static_cast<Node>(graph_.size());
    for (Node node = 0; node < end; ++node) {
        const auto& entry = graph_[node];
        const bool sign = entry.operation == Operation::sign;
        if (!sign && entry.operation != Operation::abs) continue;
        const bool occurs = std::any_of(formulas_.begin(), formulas_.end(),
                                        [&](const auto& formula) { return graph_.contains(*formula, node); });
        if (!occurs || !moves(entry.a)) continue;
        const auto at = std::find(arguments.begin(), arguments.end(), entry.a);
        if (at == arguments.end()) {
            arguments.push_back(entry.a);
            jumps.push_back(sign);
        } else if (sign) {
            jumps[static_cast<std::size_t>(at - arguments.begin())] = true;
        }
    }
    std::vector<Node>& surfaces = equations_->surfaces_;
    if (!text_.switching) {
        surfaces = arguments;
    } else {
        for (std::size_t i = 0; i < text_.switching->size(); ++i) {
            auto node = parsed(Part::switching, i, (*text_.switching)[i]);
            if (!node) continue;
            if (graph_[*node].operation == Operation::negate) node = graph_[*node].a;
            if (std::find(arguments.begin(), arguments.end(), *node) == arguments.end())
                report(Part::switching, i,
                       "no sign() or abs() of the equations has this argument: write it as it stands there");
            else if (std::find(surfaces.begin(), surfaces.end(), *node) != surfaces.end())
                report(Part::switching, i, "the surface is listed twice");
            else
                surfaces.push_back(*node);
        }
        // Of a surface that is listed with a mistake one problem is enough.
        const bool listed = problems_.size() == problems_before_;
        for (std::size_t k = 0; listed && k < arguments.size(); ++k)
            if (jumps[k] && std::find(surfaces.begin(), surfaces.end(), arguments[k]) == surfaces.end())
                report(Part::model, 0,
                       "the equations jump with a sign() whose argument \"switching\" does not list: list it, or leave "
                       "\"switching\" out");
    }
    if (surfaces.size() > Equations::most_surfaces)
        report(Part::model, 0,
               fmt::format("{} switching surfaces: at most {}", surfaces.size(), Equations::most_surfaces));
    if (!surfaces.empty() && text_.stiff)
        report(Part::model, 0, "a stiff model must be smooth: implicit steps do not look for switching surfaces");
}

void EquationReader::put_sides() {
    auto& surfaces = equations_->surfaces_;
    const auto side_of = [&](Node argument) -> std::optional<Node> {
        const auto at = std::find(surfaces.begin(), surfaces.end(), argument);
        if (at == surfaces.end()) return std::nullopt;
        return graph_.variable(Operation::side, static_cast<std::size_t>(at - surfaces.begin()));
    };
    std::map<Node, Node> known;
    // Outer signs may stand around inner ones, so an argument is looked up as it was and replaced afterwards.
    const std::function<std::optional<Node>(Node)> replaced = [&](Node node) -> std::optional<Node> {
        const auto entry = graph_[node];
        if (entry.operation != Operation::sign && entry.operation != Operation::abs) return std::nullopt;
        const auto side = side_of(entry.a);
        if (!side) return std::nullopt;
        if (entry.operation == Operation::sign) return side;
        return graph_.apply(Operation::multiply, *side, graph_.replace(entry.a, replaced, known));
    };
    for (const auto& formula : formulas_)
        equations_->rates_.push_back(graph_.replace(*formula, replaced, known));
    for (Node& surface : surfaces) {
        const Node smooth_surface = graph_.replace(surface, replaced, known);
        for (std::size_t j = 0; j < surfaces.size(); ++j)
            if (graph_.contains(smooth_surface, graph_.variable(Operation::side, j)))
                report(Part::model, 0, "the argument of a sign() or abs() contains another one that jumps");
    }
}

void EquationReader::find_friction() {
    const auto& surfaces = equations_->surfaces_;
    const Node speed = graph_.variable(Operation::coordinate, 1);
    if (surfaces.size() != 1 || text_.coordinates.size() != 2 || surfaces[0] != speed || equations_->rates_[0] != speed)
        return;
    // Friction opposes the motion: f on the side +1 is below that on -1, at velocity 0.
    const Node rate = equations_->rates_[1];
    bool opposes = true;
    for (std::size_t trial = 0; trial < 8; ++trial) {
        const auto at = [&](double side) {
            return graph_.values(std::span(&rate, 1), [&](const ExpressionGraph::Entry& entry) {
                switch (entry.operation) {
                    case Operation::parameter:
                        return text_.parameters[entry.index].value;
                    case Operation::side:
                        return side;
                    case Operation::coordinate:
                        return entry.index == 1 ? 0.0 : sample(trial);
                    default:
                        return sample(trial + 8 + entry.index);
                }
            })[0];
        };
        opposes = opposes && !(at(1.0) > at(-1.0));
    }
    equations_->dry_friction_ = opposes;
}

void EquationReader::find_jumps() {
    const auto& surfaces = equations_->surfaces_;
    for (std::size_t j = 0; j < surfaces.size(); ++j) {
        std::vector<std::pair<Node, Node>> sides;
        const Node side = graph_.variable(Operation::side, j);
        for (const Node rate : equations_->rates_) {
            const auto on = [&](double value) {
                std::map<Node, Node> known;
                return graph_.replace(
                    rate,
                    [&](Node node) -> std::optional<Node> {
                        if (node == surfaces[j]) return graph_.number(0.0);
                        if (node == side) return graph_.number(value);
                        return std::nullopt;
                    },
                    known);
            };
            const Node above = on(1.0);
            sides.emplace_back(above, on(-1.0));
        }
        equations_->on_surface_.push_back(std::move(sides));
    }
}

void EquationReader::check_symmetry() {
    if (!text_.symmetry) return;
    const std::vector<double>& signs = text_.symmetry->signs;
    const bool fits = signs.size() == text_.coordinates.size() &&
                      std::all_of(signs.begin(), signs.end(), [](double s) { return s == 1.0 || s == -1.0; });
    if (!fits) {
        report(Part::symmetry, 0, "one sign, 1 or -1, for each coordinate");
        return;
    }
    if (!text_.forcing && text_.symmetry->phase_shift != 0.0) {
        report(Part::symmetry, 0, "\"phase_shift\" is of forced models only");
        return;
    }
    // f(S x, tau + shift) = S f(x, tau), in some states. Terms cancel to rounding of the largest of them.
    std::vector<Node> formulas;
    for (const auto& formula : formulas_)
        formulas.push_back(*formula);
    for (std::size_t trial = 0; trial < 4; ++trial) {
        const auto rates = [&](bool mirrored) {
            return graph_.values(formulas, [&](const ExpressionGraph::Entry& entry) {
                const double x = sample(7 * trial + entry.index);
                switch (entry.operation) {
                    case Operation::parameter:
                        return text_.parameters[entry.index].value;
                    case Operation::coordinate:
                        return mirrored ? signs[entry.index] * x : x;
                    case Operation::phase:
                        return mirrored ? x + text_.symmetry->phase_shift : x;
                    default:
                        return 0.0;
                }
            });
        };
        const auto here = rates(false), there = rates(true);
        double size = 0.0;
        for (const double f : here)
            size = std::max(size, std::abs(f));
        for (std::size_t i = 0; i < here.size(); ++i) {
            // No decision is possible where f has no value.
            if (!std::isfinite(here[i]) || !std::isfinite(there[i])) continue;
            if (std::abs(there[i] - signs[i] * here[i]) <= 1e-9 * (1.0 + size)) continue;
            report(Part::symmetry, 0,
                   fmt::format("the equation of {} has no such symmetry: f(S x, phase + shift) must be S f(x, phase), "
                               "and is {} in the place of {} at a trial state",
                               text_.coordinates[i].name, there[i], signs[i] * here[i]));
            return;
        }
    }
}

}  // namespace orbid::models
