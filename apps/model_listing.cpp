#include "apps/model_listing.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "models/registry.hpp"

namespace orbid::apps {

std::vector<std::string> model_names() {
    std::vector<std::string> names;
    for (const models::ModelEntry& entry : models::registered_models())
        names.emplace_back(entry.name);
    return names;
}

std::string model_list() {
    std::string text;
    for (const models::ModelEntry& entry : models::registered_models()) {
        text += fmt::format("{:<22}{}\n", entry.name, entry.summary);
    }
    return text;
}

std::string model_page(std::string_view name) {
    const auto system = models::make_system(name);  // refuses unknown names
    const auto entries = models::registered_models();
    const auto entry = std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.name == name; });
    std::string text = fmt::format("{}: {}\n\n{}\n", entry->name, entry->summary, entry->equations);
    if (!entry->variants.empty()) {
        text += "\nvariants:    ";
        for (const auto& variant : entry->variants) {
            text += fmt::format(" {}{}", variant, variant == entry->variants.front() ? " (default)" : "");
        }
        text += '\n';
    }
    text += fmt::format("\nkind:         {}\n", system->kind() == models::Kind::forced       ? "forced periodically"
                                                : system->kind() == models::Kind::autonomous ? "autonomous"
                                                                                             : "map");
    bool has_angle = false;
    text += "coordinates: ";
    for (const models::Coordinate& coordinate : system->coordinates()) {
        has_angle = has_angle || coordinate.angle;
        text += fmt::format(" {} [{}{}]", coordinate.name, coordinate.unit, coordinate.angle ? ", angle" : "");
    }
    text += fmt::format("\nsensors:      state{}\n\nparameters:\n", has_angle ? " angle_difference" : "");
    text += fmt::format("  {:<10}{:<10}{:<18}{:<14}{}\n", "name", "unit", "domain", "default", "");
    for (const models::Parameter& parameter : system->parameters()) {
        text += fmt::format("  {:<10}{:<10}{:<18}{:<14}{}\n", parameter.name, parameter.unit,
                            models::rule(parameter.domain), parameter.default_value, parameter.description);
    }
    return text;
}

}  // namespace orbid::apps
