#include <map>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/evaluated_model.hpp"
#include "apps/job/job_parts.hpp"
#include "models/catalogue/registry.hpp"
#include "models/equations/equations.hpp"

namespace orbid::apps {

namespace {

using Part = models::EquationProblem::Part;
using Quantity = models::EquationText::Quantity;

/// A model written in a job on its way from JSON to models::EquationText, with the values that problems are shown at.
class EquationBlock {
public:
    EquationBlock(ObjectReader& model, const std::vector<std::string>& used_outside, Job& job)
        : model_(model), job_(job), equations_(*model.find("equations")) {
        text_.used_outside = used_outside;
    }

    void read() {
        const std::size_t before = equations_.problem_count();
        read_name();
        read_texts();
        read_parameters();
        read_kind();
        read_lists();
        read_symmetry();
        read_choices();
        model_.finish();
        // What is no text, name or number cannot be understood further.
        if (!model_.self().sound() || equations_.problem_count() > before) return;
        std::vector<models::EquationProblem> problems;
        const auto equations = models::Equations::read(text_, problems);
        for (const models::EquationProblem& problem : problems)
            show(problem);
        if (!equations) return;
        job_.model.equations = equations;
        job_.model.name = text_.name;
        job_.model.compile = compile_;
        std::string why;
        job_.model.system = system_of(equations, job_.model.compiled, why);
        if (!job_.model.system) {
            equations_.report(why);
            job_.model.equations.reset();
            return;
        }
        job_.model.values = job_.model.system->default_parameters();
    }

private:
    void read_name() {
        const auto name = model_.find("name");
        if (!name) return;
        const auto read = name->text();
        if (!read) return;
        for (const models::ModelEntry& entry : models::registered_models())
            if (entry.name == *read) {
                name->report(fmt::format("\"{}\" is a model of orbid: equations need a name of their own", *read));
                return;
            }
        text_.name = *read;
    }

    void read_texts() {
        for (const auto& [name, member] : equations_.members()) {
            at_[Part::coordinate].push_back(member);
            if (const auto text = member.text()) text_.coordinates.push_back({name, *text});
        }
        if (const auto order = model_.find("coordinates")) put_in_order(*order);
        if (const auto definitions = model_.find("definitions")) {
            for (const auto& [name, member] : definitions->members()) {
                at_[Part::definition].push_back(member);
                if (const auto text = member.text()) text_.definitions.push_back({name, *text});
            }
        }
        if (const auto units = model_.find("units")) {
            for (const auto& [name, member] : units->members()) {
                const auto unit = member.text();
                if (Quantity* coordinate = coordinate_of(name, member); coordinate != nullptr && unit)
                    coordinate->unit = *unit;
            }
        }
    }

    /// The coordinates in the order of a list that has all of them.
    void put_in_order(const ValueReader& order) {
        const auto names = read_names(order);
        std::vector<Quantity> sorted;
        std::vector<ValueReader> places;
        for (const auto& [name, item] : names)
            for (std::size_t i = 0; i < text_.coordinates.size(); ++i)
                if (text_.coordinates[i].name == name) {
                    sorted.push_back(text_.coordinates[i]);
                    places.push_back(at_[Part::coordinate][i]);
                }
        if (names.size() != text_.coordinates.size() || sorted.size() != names.size()) {
            order.report("must list every name of \"equations\" once: the order of the state");
            return;
        }
        text_.coordinates = sorted;
        at_[Part::coordinate] = places;
    }

    void read_parameters() {
        const auto value = model_.find("parameters");
        if (!value) return;
        for (const auto& [name, member] : value->members()) {
            at_[Part::parameter].push_back(member);
            models::EquationText::Parameter parameter;
            parameter.name = name;
            if (member.is(JsonValue::Kind::object)) {
                read_parameter(member, parameter);
            } else {
                member.read(parameter.value);
            }
            text_.parameters.push_back(std::move(parameter));
        }
        if (value->sound() && value->members().empty()) value->report("no parameter: at least one, { \"k\": 1.0 }");
    }

    static void read_parameter(const ValueReader& member, models::EquationText::Parameter& parameter) {
        ObjectReader object(member);
        read_fields(object, describe::equation_parameter_fields(), parameter);
        object.finish();
    }

    void read_kind() {
        const auto kind = model_.find("kind");
        const auto choice = kind ? kind->choice({"flow", "map"}) : std::nullopt;
        text_.map = choice == 1;
        const auto phase = model_.find("forcing_phase");
        if (!phase) return;
        at_[Part::forcing].push_back(*phase);
        models::EquationText::Forcing forcing{"phase", ""};
        if (phase->is(JsonValue::Kind::object)) {
            ObjectReader object(*phase);
            object.read("name", forcing.phase);
            object.read("frequency", forcing.frequency);
            object.finish();
        } else if (phase->is(JsonValue::Kind::string)) {
            forcing.frequency = phase->value().text;
        }
        text_.forcing = forcing;
    }

    void read_lists() {
        if (const auto angles = model_.find("angles")) {
            for (const ValueReader& item : angles->items()) {
                const auto name = item.text();
                if (!name) continue;
                Quantity* coordinate = coordinate_of(*name, item);
                if (coordinate == nullptr) continue;
                coordinate->angle = true;
                // Angles are in radians, whatever is said of them: sin and cos read them so.
                if (coordinate->unit == "1") coordinate->unit = "rad";
                if (coordinate->unit != "rad")
                    item.report(fmt::format("an angle is in rad, not in {}", coordinate->unit));
            }
        }
        if (const auto switching = model_.find("switching")) {
            text_.switching.emplace();
            for (const ValueReader& item : switching->items()) {
                at_[Part::switching].push_back(item);
                if (const auto text = item.text()) text_.switching->push_back(*text);
            }
        }
        if (const auto inputs = model_.find("inputs")) {
            for (const auto& [name, member] : inputs->members()) {
                at_[Part::input].push_back(member);
                text_.inputs.push_back({name, "", member.text().value_or("1")});
            }
        }
    }

    void read_symmetry() {
        const auto value = model_.find("symmetry");
        if (!value) return;
        at_[Part::symmetry].push_back(*value);
        ObjectReader object(*value);
        models::Symmetry symmetry;
        symmetry.signs.assign(text_.coordinates.size(), 1.0);
        if (const auto signs = object.find("signs")) {
            for (const auto& [name, member] : signs->members()) {
                const auto sign = member.number();
                if (const Quantity* coordinate = coordinate_of(name, member); coordinate != nullptr && sign)
                    symmetry.signs[static_cast<std::size_t>(coordinate - text_.coordinates.data())] = *sign;
            }
        }
        object.read("phase_shift", symmetry.phase_shift);
        object.finish();
        text_.symmetry = symmetry;
    }

    void read_choices() {
        model_.read("stiff", text_.stiff);
        if (const auto compile = model_.find("compile")) {
            if (compile->is(JsonValue::Kind::boolean))
                compile_ = compile->value().boolean ? CompileChoice::always : CompileChoice::never;
            else
                (void)compile->choice({"auto"});
        }
    }

    Quantity* coordinate_of(const std::string& name, const ValueReader& at) {
        std::vector<std::string> known;
        for (Quantity& coordinate : text_.coordinates) {
            if (coordinate.name == name) return &coordinate;
            known.push_back(coordinate.name);
        }
        at.report(fmt::format("\"{}\" is no coordinate of the equations{}", name, suggestion(name, known)));
        return nullptr;
    }

    void show(const models::EquationProblem& problem) const {
        const auto part = at_.find(problem.part);
        if (part == at_.end() || problem.index >= part->second.size()) return equations_.report(problem.rule);
        const ValueReader& at = part->second[problem.index];
        if (problem.position)
            at.report_character(*problem.position, problem.rule);
        else
            at.report(problem.rule);
    }

    ObjectReader& model_;
    Job& job_;
    ValueReader equations_;
    models::EquationText text_;
    CompileChoice compile_ = CompileChoice::automatic;
    std::map<Part, std::vector<ValueReader>> at_;
};

}  // namespace

void read_equations(ObjectReader& model, const std::vector<std::string>& used_outside, Job& job) {
    EquationBlock(model, used_outside, job).read();
}

}  // namespace orbid::apps
