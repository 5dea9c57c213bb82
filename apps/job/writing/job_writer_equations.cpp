#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;

/// A number, where that says everything.
Json parameter_document(models::EquationText::Parameter parameter, double value) {
    if (parameter.unit == "1" && parameter.domain == models::Domain::real && !parameter.typical &&
        parameter.description.empty())
        return value;
    parameter.value = value;
    return fields_document(parameter, describe::equation_parameter_fields());
}

}  // namespace

Json equations_document(const Job& job) {
    const models::EquationText& text = job.model.equations->text();
    Json model{{"name", text.name}, {"equations", Json::object()}, {"coordinates", Json::array()}};
    Json units = Json::object(), angles = Json::array(), signs = Json::object();
    for (std::size_t i = 0; i < text.coordinates.size(); ++i) {
        const auto& coordinate = text.coordinates[i];
        model["equations"][coordinate.name] = coordinate.text;
        // The order of an object's keys is not everybody's to keep.
        model["coordinates"].push_back(coordinate.name);
        units[coordinate.name] = coordinate.unit;
        if (coordinate.angle) angles.push_back(coordinate.name);
        if (text.symmetry) signs[coordinate.name] = text.symmetry->signs[i];
    }
    for (const auto& definition : text.definitions)
        model["definitions"][definition.name] = definition.text;
    model["kind"] = text.map ? "map" : "flow";
    model["units"] = std::move(units);
    model["parameters"] = Json::object();
    for (std::size_t i = 0; i < text.parameters.size(); ++i)
        model["parameters"][text.parameters[i].name] =
            parameter_document(text.parameters[i], job.model.values[static_cast<Eigen::Index>(i)]);
    if (text.forcing) model["forcing_phase"] = {{"name", text.forcing->phase}, {"frequency", text.forcing->frequency}};
    if (!angles.empty()) model["angles"] = std::move(angles);
    if (text.switching) model["switching"] = *text.switching;
    for (const auto& input : text.inputs)
        model["inputs"][input.name] = input.unit;
    if (text.symmetry) {
        model["symmetry"]["signs"] = std::move(signs);
        if (text.forcing) model["symmetry"]["phase_shift"] = text.symmetry->phase_shift;
    }
    model["stiff"] = text.stiff;
    if (job.model.compile == CompileChoice::automatic)
        model["compile"] = "auto";
    else
        model["compile"] = job.model.compile == CompileChoice::always;
    return model;
}

}  // namespace orbid::apps::detail
