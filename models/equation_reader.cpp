#include "models/equation_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "models/model_members.hpp"

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Operation = ExpressionGraph::Operation;

/// Fractional parts of multiples of the golden ratio: numbers in (-1.5, 1.5) without a pattern, the same in every run.
double sample(std::size_t i) {
    const double x = static_cast<double>(i + 1) * 0.6180339887498949;
    return 3.0 * (x - std::floor(x)) - 1.5;
}

}  // namespace

EquationReader::EquationReader(const EquationText& text, std::vector<EquationProblem>& problems)
    : text_(text),
      problems_(problems),
      problems_before_(problems.size()),
      equations_(new Equations(text)),
      graph_(equations_->graph_) {}

void EquationReader::report(Part part, std::size_t index, std::string rule, std::optional<std::size_t> position) {
    problems_.push_back({part, index, position, std::move(rule)});
}

std::shared_ptr<const Equations> EquationReader::read() {
    read_names();
    read_forcing();
    read_formulas();
    if (graph_.size() > Equations::most_operations)
        report(Part::model, 0,
               fmt::format("the formulas have {} different parts, at most {} are read", graph_.size(),
                           Equations::most_operations));
    if (problems_.size() > problems_before_) return nullptr;
    check_numbers();
    check_use();
    find_surfaces();
    if (problems_.size() > problems_before_) return nullptr;
    put_sides();
    make_tables();
    find_friction();
    find_jumps();
    check_symmetry();
    if (problems_.size() > problems_before_) return nullptr;
    return equations_;
}

void EquationReader::add_name(Part part, std::size_t index, const std::string& name, Node node) {
    const auto description = [&]() -> std::string {
        switch (part) {
            case Part::coordinate:
                return "a coordinate";
            case Part::definition:
                return "a definition";
            case Part::parameter:
                return "a parameter";
            case Part::input:
                return "an input";
            default:
                return "the phase";
        }
    }();
    if (!detail::is_name(name)) {
        report(part, index, fmt::format("\"{}\" is no name: letters, digits and _, no digit first", name));
    } else if (is_reserved_word(name)) {
        report(part, index, fmt::format("\"{}\" is a word of the formulas (pi or a function)", name));
    } else if (const auto [at, fresh] = known_.try_emplace(name, description); !fresh) {
        report(part, index, fmt::format("\"{}\" is {} already", name, at->second));
    } else {
        names_.push_back(name);
        nodes_.push_back(node);
    }
}

void EquationReader::read_names() {
    const auto at_most = [&](std::size_t count, std::size_t most, const char* what) {
        if (count > most) report(Part::model, 0, fmt::format("{} {}: at most {}", count, what, most));
    };
    at_most(text_.coordinates.size(), Equations::most_coordinates, "equations");
    at_most(text_.definitions.size(), 4 * Equations::most_coordinates, "definitions");
    at_most(text_.parameters.size(), Equations::most_parameters, "parameters");
    at_most(text_.inputs.size(), Equations::most_surfaces, "inputs");
    if (text_.coordinates.empty()) report(Part::model, 0, "no equation: one per coordinate, { \"x\": \"...\" }");
    if (text_.parameters.empty()) report(Part::model, 0, "no parameter: at least one, { \"k\": 1.0 }");
    for (std::size_t i = 0; i < text_.coordinates.size(); ++i)
        add_name(Part::coordinate, i, text_.coordinates[i].name, graph_.variable(Operation::coordinate, i));
    for (std::size_t i = 0; i < text_.parameters.size(); ++i)
        add_name(Part::parameter, i, text_.parameters[i].name, graph_.variable(Operation::parameter, i));
    for (std::size_t i = 0; i < text_.inputs.size(); ++i)
        add_name(Part::input, i, text_.inputs[i].name, graph_.variable(Operation::input, i));
    for (std::size_t i = 0; i < text_.parameters.size(); ++i) {
        const auto& parameter = text_.parameters[i];
        if (!contains(parameter.domain, parameter.value))
            report(Part::parameter, i,
                   fmt::format("{} must be {}, not {}", parameter.name, rule(parameter.domain), parameter.value));
    }
    if (text_.map && !text_.inputs.empty()) report(Part::model, 0, "a map has no measured inputs");
    if (text_.map && text_.stiff) report(Part::model, 0, "a map takes no steps: it is not stiff");
}

void EquationReader::read_forcing() {
    if (!text_.forcing) return;
    if (text_.map) report(Part::forcing, 0, "a map has no phase of a forcing: its sections are its iterates");
    if (!text_.inputs.empty()) report(Part::forcing, 0, "a forced model has a clock of its own and no measured inputs");
    for (std::size_t i = 0; i < text_.parameters.size(); ++i)
        if (text_.parameters[i].name == text_.forcing->frequency) equations_->frequency_ = i;
    if (!equations_->frequency_) {
        report(Part::forcing, 0, fmt::format("the frequency \"{}\" is no parameter", text_.forcing->frequency));
    } else if (!(text_.parameters[*equations_->frequency_].value > 0.0)) {
        report(Part::parameter, *equations_->frequency_,
               fmt::format("{} is the frequency of the forcing [rad/s] and must be > 0", text_.forcing->frequency));
    }
    add_name(Part::forcing, 0, text_.forcing->phase, graph_.variable(Operation::phase, 0));
}

std::optional<Node> EquationReader::parsed(Part part, std::size_t index, const std::string& text) {
    try {
        const Expression expression = Expression::parse(text, names_);
        for (const std::size_t name : expression.used())
            used_[name] = true;
        return graph_.insert(expression, nodes_);
    } catch (const ExpressionError& error) {
        std::string rule = error.what();
        const bool time = text.compare(std::min(error.position, text.size()), 1, "t") == 0 &&
                          rule.find("unknown name \"t\"") != std::string::npos;
        if (time)
            rule += text_.inputs.empty() ? "; time enters as the phase of a forcing (\"forcing_phase\")"
                                         : "; time enters through the measured inputs";
        report(part, index, std::move(rule), error.position);
        return std::nullopt;
    }
}

void EquationReader::read_formulas() {
    used_.assign(names_.size() + text_.definitions.size(), false);
    for (std::size_t i = 0; i < text_.definitions.size(); ++i) {
        const auto node = parsed(Part::definition, i, text_.definitions[i].text);
        // Named all the same: that it is unknown to what follows would be a second error of one mistake.
        add_name(Part::definition, i, text_.definitions[i].name, node.value_or(graph_.number(1.0)));
    }
    for (std::size_t i = 0; i < text_.coordinates.size(); ++i)
        formulas_.push_back(parsed(Part::coordinate, i, text_.coordinates[i].text));
}

void EquationReader::check_numbers() {
    for (std::size_t i = 0; i < formulas_.size(); ++i)
        for (Node node = 0; node < graph_.size(); ++node)
            if (graph_[node].operation == Operation::number && !std::isfinite(graph_[node].value) &&
                graph_.contains(*formulas_[i], node)) {
                report(Part::coordinate, i, "a part of the formula without variables has no finite value");
                break;
            }
}

void EquationReader::check_use() {
    for (std::size_t name = 0; name < names_.size(); ++name) {
        if (used_[name]) continue;
        for (std::size_t i = 0; i < text_.parameters.size(); ++i)
            if (text_.parameters[i].name == names_[name] && equations_->frequency_ != i)
                report(Part::parameter, i,
                       fmt::format("the parameter {} occurs in no formula: remove it", names_[name]));
        for (std::size_t i = 0; i < text_.inputs.size(); ++i)
            if (text_.inputs[i].name == names_[name])
                report(Part::input, i, fmt::format("the input {} occurs in no formula", names_[name]));
        for (std::size_t i = 0; i < text_.definitions.size(); ++i)
            if (text_.definitions[i].name == names_[name])
                report(Part::definition, i, fmt::format("the definition {} is used in no formula", names_[name]));
        if (text_.forcing && text_.forcing->phase == names_[name])
            report(
                Part::forcing, 0,
                fmt::format("the phase \"{}\" occurs in no formula: without it the model is autonomous", names_[name]));
    }
}

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

void EquationReader::make_tables() {
    for (const auto& coordinate : equations_->text_.coordinates)
        equations_->coordinates_.push_back({coordinate.name, coordinate.unit, coordinate.angle});
    for (const auto& input : equations_->text_.inputs)
        equations_->inputs_.push_back({input.name, input.unit, false});
    for (std::size_t i = 0; i < equations_->text_.parameters.size(); ++i) {
        const auto& p = equations_->text_.parameters[i];
        const double size = p.typical.value_or(p.value != 0.0 ? std::abs(p.value) : 1.0);
        const Domain domain = equations_->frequency_ == i ? Domain::positive : p.domain;
        equations_->parameters_.emplace_back(p.name, p.unit, domain, p.value, p.description, typical(size));
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
            // Nothing can be told where f has no value.
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
