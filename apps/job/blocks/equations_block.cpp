#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/blocks/model_block.hpp"
#include "apps/job/evaluated_model.hpp"
#include "models/equations/equations.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Part = models::EquationProblem::Part;
using models::EquationText;
using Quantity = EquationText::Quantity;

/// As jobs write them, in the order of EquationText::map.
const std::vector<std::string> equation_kind_names{"flow", "map"};

ValueSchema formulas_of(std::string names) {
    return entries(text("a formula"), std::move(names), {}, 1);
}

Quantity* equation_coordinate(const std::string& name, const ValueReader& at, ModelBlock& block) {
    std::vector<std::string> known;
    for (Quantity& coordinate : block.text.coordinates) {
        if (coordinate.name == name) return &coordinate;
        known.push_back(coordinate.name);
    }
    at.report(fmt::format("\"{}\" is no coordinate of the equations{}", name, suggestion(name, known)));
    return nullptr;
}

/// { "x": "v", ... }: a text of each quantity.
Json texts_of(const std::vector<Quantity>& quantities, std::string Quantity::*member) {
    if (quantities.empty()) return left_out();
    Json texts = Json::object();
    for (const Quantity& quantity : quantities)
        texts[quantity.name] = quantity.*member;
    return texts;
}

/// Quantities that are named here, each with a text.
Field<ModelBlock> quantities_field(KeySchema key, Part part, std::vector<Quantity> EquationText::*list,
                                   std::string Quantity::*member) {
    return {std::move(key),
            [=](const ValueReader& value, const Job&, ModelBlock& block) {
                for (const auto& [name, item] : value.members()) {
                    block.at[part].push_back(item);
                    const auto read = item.text();
                    if (!read) continue;
                    Quantity& quantity = (block.text.*list).emplace_back();
                    quantity.name = name;
                    quantity.*member = *read;
                }
            },
            [=](const ModelBlock& block, const Writing&) { return texts_of(block.text.*list, member); }};
}

/// The coordinates in the order of a list that has all of them.
void read_equation_order(const ValueReader& order, const Job&, ModelBlock& block) {
    const auto named = read_names(order);
    std::vector<Quantity> sorted;
    std::vector<ValueReader> places;
    auto& coordinates = block.text.coordinates;
    for (const auto& [name, item] : named)
        for (std::size_t i = 0; i < coordinates.size(); ++i)
            if (coordinates[i].name == name) {
                sorted.push_back(coordinates[i]);
                places.push_back(block.at[Part::coordinate][i]);
            }
    if (named.size() != coordinates.size() || sorted.size() != named.size()) {
        order.report("must list every name of \"equations\" once: the order of the state");
        return;
    }
    coordinates = sorted;
    block.at[Part::coordinate] = places;
}

void read_equation_units(const ValueReader& value, const Job&, ModelBlock& block) {
    for (const auto& [name, item] : value.members()) {
        const auto unit = item.text();
        if (Quantity* coordinate = equation_coordinate(name, item, block); coordinate != nullptr && unit)
            coordinate->unit = *unit;
    }
}

const FieldTable<EquationText::Forcing>& forcing_fields() {
    using Forcing = EquationText::Forcing;
    static const FieldTable<Forcing> table{
        open_field(key("name", text(), "What the phase is called in the equations.").by_default("phase"),
                   &Forcing::phase),
        open_field(key("frequency", text(), "The parameter omega of the phase omega t.").in("rad/s").required_always(),
                   &Forcing::frequency)};
    return table;
}

void read_equation_forcing(const ValueReader& value, const Job&, ModelBlock& block) {
    block.at[Part::forcing].push_back(value);
    EquationText::Forcing& forcing = block.text.forcing.emplace(EquationText::Forcing{"phase", ""});
    if (value.is(JsonValue::Kind::object))
        read_object(value, forcing_fields(), forcing);
    else
        value.read(forcing.frequency);
}

void read_equation_angles(const ValueReader& value, const Job&, ModelBlock& block) {
    for (const auto& [name, item] : read_names(value)) {
        Quantity* coordinate = equation_coordinate(name, item, block);
        if (coordinate == nullptr) continue;
        coordinate->angle = true;
        // Angles are in radians, whatever is said of them: sin and cos read them so.
        if (coordinate->unit == "1") coordinate->unit = "rad";
        if (coordinate->unit != "rad") item.report(fmt::format("an angle is in rad, not in {}", coordinate->unit));
    }
}

Json equation_angles_document(const ModelBlock& block, const Writing&) {
    Json angles = Json::array();
    for (const Quantity& coordinate : block.text.coordinates)
        if (coordinate.angle) angles.push_back(coordinate.name);
    return angles.empty() ? left_out() : angles;
}

void read_equation_switching(const ValueReader& value, const Job&, ModelBlock& block) {
    block.text.switching.emplace();
    for (const ValueReader& item : value.items()) {
        block.at[Part::switching].push_back(item);
        if (const auto read = item.text()) block.text.switching->push_back(*read);
    }
}

const FieldTable<ModelBlock>& equation_symmetry_fields() {
    static const FieldTable<ModelBlock> table{
        {key("signs", entries(one_of({1.0, -1.0}), "a coordinate"),
             "Of the coordinates in the mirror image: { \"x\": -1 }; one not named keeps its sign.")
             .required_always(),
         [](const ValueReader& value, const Job&, ModelBlock& block) {
             for (const auto& [name, item] : value.members()) {
                 const auto sign = item.number();
                 const Quantity* coordinate = equation_coordinate(name, item, block);
                 if (coordinate == nullptr || !sign) continue;
                 block.text.symmetry->signs[static_cast<std::size_t>(coordinate - block.text.coordinates.data())] =
                     *sign;
             }
         },
         [](const ModelBlock& block, const Writing&) {
             Json signs = Json::object();
             for (std::size_t i = 0; i < block.text.coordinates.size(); ++i)
                 signs[block.text.coordinates[i].name] = block.text.symmetry->signs[i];
             return signs;
         }},
        {key("phase_shift", number(), "By which the phase of the mirror image is shifted.").in("rad").by_default(0.0),
         [](const ValueReader& value, const Job&, ModelBlock& block) { value.read(block.text.symmetry->phase_shift); },
         [](const ModelBlock& block, const Writing&) {
             return block.text.forcing ? Json(block.text.symmetry->phase_shift) : left_out();
         }}};
    return table;
}

void read_equation_symmetry(const ValueReader& value, const Job& job, ModelBlock& block) {
    block.at[Part::symmetry].push_back(value);
    block.text.symmetry.emplace().signs.assign(block.text.coordinates.size(), 1.0);
    read_object(value, equation_symmetry_fields(), block, job);
}

void read_compile(const ValueReader& value, const Job&, ModelBlock& block) {
    if (value.is(JsonValue::Kind::boolean))
        block.model.compile = value.value().boolean ? CompileChoice::always : CompileChoice::never;
}

Json compile_document(const ModelBlock& block, const Writing&) {
    if (block.model.compile == CompileChoice::automatic) return "auto";
    return block.model.compile == CompileChoice::always;
}

/// The keys of what is less often said.
FieldTable<ModelBlock> special_fields() {
    return {{key("angles", names(), "Coordinates that are angles, in rad.").standard_text("[]"), read_equation_angles,
             equation_angles_document},
            {key("switching", set(text()), "Expressions at whose zeros the equations jump."), read_equation_switching,
             [](const ModelBlock& block, const Writing&) {
                 return block.text.switching ? Json(*block.text.switching) : left_out();
             }},
            quantities_field(key("inputs", entries(text(), "an input"), "Measured inputs with their units."),
                             Part::input, &EquationText::inputs, &Quantity::unit),
            {key("symmetry", object(keys_of(equation_symmetry_fields())), "Of the solutions."), read_equation_symmetry,
             [](const ModelBlock& block, const Writing& at) {
                 return block.text.symmetry ? fields_document(block, equation_symmetry_fields(), at) : left_out();
             }},
            field(key("stiff", boolean(), "Slow and fast scales far apart: steps by an implicit method."),
                  &ModelBlock::text, &EquationText::stiff),
            {key("compile", choice({"auto"}) | boolean(), "Compile the equations; \"auto\": where it is worth it.")
                 .by_default("auto"),
             read_compile, compile_document}};
}

}  // namespace

const FieldTable<EquationText::Parameter>& equation_parameter_fields() {
    using Parameter = EquationText::Parameter;
    static const FieldTable<Parameter> table{
        open_field(key("value", number(), "Its value.").required_always(), &Parameter::value),
        field(key("unit", text(), "Its unit."), &Parameter::unit),
        choice_field(key("domain", {}, "The values that it can have."), domain_names, &Parameter::domain),
        open_field(key("typical", above(0.0), "Its typical size; that of its value unless given."),
                   &Parameter::typical),
        text_field(key("description", text(), "What it is.").by_default(""), &Parameter::description)};
    return table;
}

FieldTable<ModelBlock> equations_fields() {
    FieldTable<ModelBlock> table{
        quantities_field(key("equations", formulas_of("a coordinate"),
                             "A model written in the job: the derivative of each coordinate, or its next value: { "
                             "\"x\": \"v\", \"v\": \"-k * x\" }."),
                         Part::coordinate, &EquationText::coordinates, &Quantity::text),
        {key("coordinates", names(1), "The order of the state; that of \"equations\" unless given."),
         read_equation_order,
         [](const ModelBlock& block, const Writing&) {
             return json_list(block.text.coordinates, [](const Quantity& coordinate) { return coordinate.name; });
         }},
        quantities_field(key("definitions", formulas_of("a quantity"), "Formulas that the equations use by name."),
                         Part::definition, &EquationText::definitions, &Quantity::text),
        {key("kind", choice(equation_kind_names), "Derivatives, or next values.").by_default("flow"),
         [](const ValueReader& value, const Job&, ModelBlock& block) {
             block.text.map = value.choice(equation_kind_names) == 1;
         },
         [](const ModelBlock& block, const Writing&) -> Json { return name_of(block.text.map, equation_kind_names); }},
        {key("units", entries(text(), "a coordinate"), "Of the coordinates."), read_equation_units,
         [](const ModelBlock& block, const Writing&) { return texts_of(block.text.coordinates, &Quantity::unit); }},
        {key("forcing_phase", text("the name of a parameter") | object(keys_of(forcing_fields())),
             "Forced models: the frequency, and the name of the phase."),
         read_equation_forcing, [](const ModelBlock& block, const Writing& at) {
             return block.text.forcing ? fields_document(*block.text.forcing, forcing_fields(), at) : left_out();
         }}};
    const FieldTable<ModelBlock> special = special_fields();
    table.insert(table.end(), special.begin(), special.end());
    for (auto one = table.begin() + 1; one != table.end(); ++one)
        one->key.with("equations");
    return table;
}

void read_equation_names(const std::optional<ValueReader>& name, const std::optional<ValueReader>& parameters,
                         ModelBlock& block) {
    if (const auto word = name ? name->text() : std::nullopt) {
        if (registered(*word) != nullptr)
            name->report(fmt::format("\"{}\" is a model of orbid: equations need a name of their own", *word));
        block.text.name = *word;
    }
    if (!parameters) return;
    for (const auto& [word, item] : parameters->members()) {
        if (word == "from") continue;
        block.at[Part::parameter].push_back(item);
        EquationText::Parameter& parameter = block.text.parameters.emplace_back();
        parameter.name = word;
        if (item.is(JsonValue::Kind::object))
            read_object(item, equation_parameter_fields(), parameter);
        else
            item.read(parameter.value);
    }
    if (parameters->sound() && parameters->members().empty())
        parameters->report("no parameter: at least one, { \"k\": 1.0 }");
}

void use_equations(const ValueReader& equations, const ModelBlock& block, Job& job) {
    std::vector<models::EquationProblem> problems;
    const auto read = models::Equations::read(block.text, problems);
    for (const models::EquationProblem& problem : problems) {
        const auto part = block.at.find(problem.part);
        const bool shown = part != block.at.end() && problem.index < part->second.size();
        const ValueReader& at = shown ? part->second[problem.index] : equations;
        if (shown && problem.position)
            at.report_character(*problem.position, problem.rule);
        else
            at.report(problem.rule);
    }
    if (!read) return;
    job.model.name = block.text.name;
    job.model.compile = block.model.compile;
    std::string why;
    job.model.system = system_of(read, job.model.compiled, why);
    if (!job.model.system) return equations.report(why);
    job.model.equations = read;
    job.model.values = job.model.system->default_parameters();
}

Json equation_parameter_document(EquationText::Parameter parameter, double value) {
    if (parameter.unit == "1" && parameter.domain == models::Domain::real && !parameter.typical &&
        parameter.description.empty())
        return value;
    parameter.value = value;
    return fields_document(parameter, equation_parameter_fields());
}

}  // namespace orbid::apps::describe
