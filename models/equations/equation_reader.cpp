#include "models/equations/equation_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/definition/model_members.hpp"

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;

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
    if (name.size() > Equations::longest_name) {
        report(part, index,
               fmt::format("\"{}...\" is a name of {} characters: at most {}", name.substr(0, 20), name.size(),
                           Equations::longest_name));
    } else if (!detail::is_name(name)) {
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
        const bool outside =
            std::find(text_.used_outside.begin(), text_.used_outside.end(), names_[name]) != text_.used_outside.end();
        for (std::size_t i = 0; i < text_.parameters.size(); ++i)
            if (text_.parameters[i].name == names_[name] && equations_->frequency_ != i && !outside)
                report(Part::parameter, i,
                       fmt::format("the parameter {} occurs in no formula: remove it", names_[name]));
        for (std::size_t i = 0; i < text_.inputs.size(); ++i)
            if (text_.inputs[i].name == names_[name] && !outside)
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

}  // namespace orbid::models
