#include "apps/program/starting/model_listing.hpp"

#include <algorithm>
#include <numbers>

#include <fmt/format.h>

#include "models/catalogue/registry.hpp"

namespace orbid::apps {

namespace {

std::string kind_text(const models::System& system) {
    std::string text = system.kind() == models::Kind::forced       ? "forced periodically"
                       : system.kind() == models::Kind::autonomous ? "autonomous"
                                                                   : "map";
    if (!system.inputs().empty()) text = "driven by measured inputs";
    return text + (system.stiff() ? ", stiff" : "");
}

std::string units_text(std::span<const models::Coordinate> table) {
    std::string text;
    for (const models::Coordinate& entry : table)
        text +=
            fmt::format("{}{} [{}{}]", text.empty() ? "" : " ", entry.name, entry.unit, entry.angle ? ", angle" : "");
    return text;
}

/// All of them, or the first and the last of a row of equal cells.
std::string coordinates_text(const models::System& system, bool cells) {
    const auto table = system.coordinates();
    if (!cells) return units_text(table);
    return fmt::format("{} ... {}", table.front().name, units_text(table.last(1)));
}

/// "(phi, phi_dot) -> (-phi, -phi_dot), half a period later"
std::string symmetry_text(const models::System& system) {
    const auto symmetry = system.symmetry();
    if (!symmetry) return "";
    std::vector<std::string> from, to;
    for (std::size_t i = 0; i < symmetry->signs.size(); ++i) {
        const auto name = system.coordinates()[i].name;
        from.emplace_back(name);
        to.push_back(fmt::format("{}{}", symmetry->signs[i] < 0.0 ? "-" : "", name));
    }
    std::string text = fmt::format("({}) -> ({})", fmt::join(from, ", "), fmt::join(to, ", "));
    const double turns = symmetry->phase_shift / (2.0 * std::numbers::pi);
    if (turns == 0.5) return text + ", half a period later";
    return turns == 0.0 ? text : fmt::format("{}, {:.6g} periods later", text, turns);
}

std::string sensors_text(const models::System& system) {
    const auto table = system.coordinates();
    const bool angle = std::any_of(table.begin(), table.end(), [](const auto& entry) { return entry.angle; });
    // Its rate is another coordinate than the angle; a map has no time between two readings.
    const bool quotient = angle && table.size() > 1 && system.kind() != models::Kind::map;
    return quotient ? "state function angle_difference" : "state function";
}

std::string parameter_row(std::string_view name, std::string_view unit, std::string_view domain, std::string_view value,
                          std::string_view description) {
    return fmt::format("  {:<9} {:<9} {:<17} {:<14} {}\n", name, unit, domain, value, description);
}

std::string parameter_row(const models::Parameter& parameter) {
    return parameter_row(parameter.name, parameter.unit, models::rule(parameter.domain),
                         fmt::format("{}", parameter.default_value), parameter.description);
}

}  // namespace

std::vector<std::string> model_names() {
    std::vector<std::string> names;
    for (const models::ModelEntry& entry : models::registered_models())
        names.emplace_back(entry.name);
    return names;
}

std::string model_list() {
    std::string text;
    for (const models::ModelEntry& entry : models::registered_models())
        text += fmt::format("{:<22}{}\n", entry.name, entry.summary);
    return text;
}

std::string model_page(std::string_view name) {
    const auto system = models::make_system(name);  // refuses unknown names
    const auto entries = models::registered_models();
    const auto entry = std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.name == name; });
    std::string text = fmt::format("{}: {}\n\n{}\n", entry->name, entry->summary, entry->equations);
    if (!entry->variants.empty()) {
        text += "\nvariants:    ";
        for (const auto& variant : entry->variants)
            text += fmt::format(" {}{}", variant, variant == entry->variants.front() ? " (default)" : "");
        text += '\n';
    }
    const auto line = [&text](std::string_view what, std::string_view value) {
        if (!value.empty()) text += fmt::format("{:<14}{}\n", fmt::format("{}:", what), value);
    };
    text += '\n';
    line("kind", kind_text(*system));
    line("size", entry->size ? fmt::format("{} to {}, \"size\" in a job (default {})", entry->size->smallest,
                                           models::ModelSize::largest, entry->size->standard)
                             : "");
    line("coordinates", coordinates_text(*system, entry->size.has_value()));
    line("symmetry", symmetry_text(*system));
    line("inputs", units_text(system->inputs()));
    line("sensors", sensors_text(*system));
    text += "\nparameters:\n";
    text += parameter_row("name", "unit", "domain", "default", "");
    for (const models::Parameter& parameter : system->parameters())
        text += parameter_row(parameter);
    for (const auto& variant : entry->variants) {
        std::string further;
        for (const models::Parameter& parameter : models::make_system(name, variant)->parameters()) {
            const auto known = system->parameters();
            if (std::none_of(known.begin(), known.end(), [&](const auto& p) { return p.name == parameter.name; }))
                further += parameter_row(parameter);
        }
        if (!further.empty()) text += fmt::format("  besides, in the variant {}:\n{}", variant, further);
    }
    return text;
}

}  // namespace orbid::apps
