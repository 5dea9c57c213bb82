#include "apps/program/starting/starting_job.hpp"

#include <algorithm>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/program/starting/model_listing.hpp"
#include "apps/program/starting/starting_orbit.hpp"
#include "models/catalogue/registry.hpp"

namespace orbid::apps {

namespace {

std::string parameter_lines(const models::System& system) {
    std::string text;
    const auto parameters = system.parameters();
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const models::Parameter& parameter = parameters[i];
        const std::string entry =
            fmt::format("\"{}\": {}{}", parameter.name, parameter.default_value, i + 1 < parameters.size() ? "," : "");
        text += fmt::format("      {:<23} // {} [{}], {}\n", entry, parameter.description, parameter.unit,
                            models::rule(parameter.domain));
    }
    return text;
}

/// A number of cells with which a first run takes seconds, for a model whose dimension is chosen.
std::optional<std::size_t> starting_size(std::string_view model) {
    const auto entries = models::registered_models();
    const auto entry = std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.name == model; });
    if (entry == entries.end() || !entry->size) return std::nullopt;
    return std::max<std::size_t>(entry->size->smallest, 6);
}

std::string size_line(std::optional<std::size_t> size) {
    if (!size) return "";
    return fmt::format(
        "    \"size\": {},                  // number of coordinates; `orbid models` shows the usual one\n", *size);
}

/// A state that every model can start from: every coordinate 1 (populations must be > 0, a pendulum must not hang) but
/// the first of many cells: equal ones would stay equal for ever.
std::string first_state(const models::System& system, bool cells) {
    std::vector<std::string_view> values(system.coordinates().size(), "1.0");
    if (cells) values.front() = "2.0";
    return fmt::format("[[{}]]", fmt::join(values, ", "));
}

std::string coordinate_names(const models::System& system, bool cells) {
    const auto table = system.coordinates();
    if (cells) return fmt::format("{} ... {}", table.front().name, table.back().name);
    std::vector<std::string_view> names;
    for (const auto& coordinate : table)
        names.push_back(coordinate.name);
    return fmt::format("{}", fmt::join(names, ", "));
}

/// Readings err, or there would be nothing to weigh by where the series itself is fitted.
std::string noise_line(const models::System& system) {
    std::vector<std::string> entries;
    for (const auto& coordinate : system.coordinates())
        entries.push_back(fmt::format("\"{}\": 0.001", coordinate.name));
    return fmt::format("      \"noise\": {{ {} }},  // sd of a reading\n", fmt::join(entries, ", "));
}

std::string data_block(const models::System& system, bool sections, bool cells, std::string_view task) {
    const bool steady = task == "waveform";
    const bool automatic = task == "auto";
    const std::string noise = automatic || task == "series" ? noise_line(system) : std::string();
    if (system.kind() == models::Kind::map) {
        const std::vector<std::string_view> small(system.coordinates().size(), "0.1");
        return fmt::format(R"(  "data": {{
    // Measured data instead: "file": "series.csv", "kind": "section", "columns": {{ "NAME": "HEADER", ... }}
    "simulate": {{
      "sections": {},                          // iterates of all trajectories together
      "transient": 300,                           // iterates left out at the start
{}      "initial": [[{}]]                  // one state per trajectory: {}
    }}
  }},
)",
                           automatic ? 8192 : 65536, noise, fmt::join(small, ", "), coordinate_names(system, cells));
    }
    if (sections && automatic) {
        return fmt::format(R"(  "data": {{
    // Measured data instead: "file": "series.csv", "kind": "section", "columns": {{ "NAME": "HEADER", ... }}
    "simulate": {{
{}      "sections": 8192, "trajectories": 4, "transient": 300
    }}
  }},
)",
                           noise);
    }
    if (sections) {
        return R"(  "data": {
    // Measured data instead: "file": "series.csv", "kind": "section", "columns": { "NAME": "HEADER", ... }
    "simulate": { "sections": 65536, "trajectories": 4, "transient": 300 }
  },
)";
    }
    return fmt::format(
        R"(  "data": {{
    // Measured data instead: "file": "series.csv", "kind": "samples", "columns": {{ "time": "t", "NAME": "HEADER", ... }}
    "simulate": {{
      "samples": {{ "step": 0.01, "count": {} }},      // seconds, samples per trajectory
{}{}      "initial": {}                             // one state per trajectory: {}
    }}
  }},
)",
        // Rows of cells are the most chaotic models: over ten seconds a start 10 % beside the value is lost.
        cells ? 201 : 1001,
        steady
            ? "      \"transient\": 10000,                         // samples left out: until the motion is periodic\n"
            : "",
        noise, first_state(system, cells), coordinate_names(system, cells));
}

/// The first parameter whose default says something: a start 10 % beside it shows an estimate at work.
const models::Parameter& first_free(const models::System& system) {
    const auto parameters = system.parameters();
    const auto found = std::find_if(parameters.begin(), parameters.end(),
                                    [](const models::Parameter& p) { return p.default_value != 0.0; });
    return found == parameters.end() ? parameters.front() : *found;
}

/// Estimated from cycles of a section, if only among other things.
bool is_of_cycles(const models::System& system, std::string_view task) {
    return task == "cycles" || (task == "auto" && system.kind() != models::Kind::autonomous);
}

/// What a residual holds beside its data.
std::string residual_keys(const models::System& system, std::string_view task) {
    if (task != "waveform") return fmt::format("\"type\": \"{}\"", task);
    const bool forced = system.kind() == models::Kind::forced;
    return fmt::format("\"type\": \"waveform\", {}, \"phase\": \"estimate\", \"offset\": \"none\"",
                       forced ? "\"period\": 1" : "\"time\": 1.0");
}

/// What is estimated from: residuals, or a strategy that chooses them.
std::string method_line(const models::System& system, std::string_view task) {
    if (task != "auto") {
        return fmt::format(
            "    \"residuals\": [ {{ {} }} ]      // \"errors\" left out: normal, with standard deviations that are "
            "estimated\n",
            residual_keys(system, task));
    }
    return "    // Stages: prediction over one interval, cycles and more of them where \"orbits\" are searched, then "
           "the "
           "series itself.\n"
           "    \"strategy\": \"auto\"        // \"scan\": true for starts that are wrong by a factor\n";
}

std::string estimate_block(const models::System& system, std::string_view task) {
    const bool cycles = is_of_cycles(system, task);
    const bool map = system.kind() == models::Kind::map;
    const std::string orbits =
        fmt::format("  \"orbits\": {{ \"periods\": {} }},       // in {}\n", map ? "[1, 2, 4, 6]" : "[1, 2, 3]",
                    map ? "iterations" : "periods of the forcing");
    const models::Parameter& free = first_free(system);
    return fmt::format(R"({}  "estimate": {{
    "parameters": {{
      // The free ones; all others keep their values. "bounds": [lower, upper] and "prior" may be added.
      "{}": {{ "start": {} }}
    }},
{}{}  }},
)",
                       cycles ? orbits : "", free.name, 1.1 * free.default_value,
                       task != "waveform" ? ""
                       : system.kind() == models::Kind::forced
                           ? "    // \"period\": of the steady state, in periods of the forcing.\n"
                           : "    // \"time\": a guess of the period in s.\n",
                       method_line(system, task));
}

/// The model block of a registered model, whose parameters keep their defaults unless they are given.
std::string model_block(std::string_view model, const models::System& system, std::optional<std::size_t> size) {
    return fmt::format(R"(  "model": {{
    "name": "{}",
{}    "parameters": {{
{}    }}
  }},
)",
                       model, size_line(size), parameter_lines(system));
}

/// The registered model that the starting job of equations writes out.
constexpr std::string_view written_out = "duffing";

/// A model without C++: the equations of `written_out` as a job holds them.
constexpr std::string_view equations_block = R"job(  "model": {
    "name": "spring",                  // any name that `orbid models` does not list
    // The derivative of each coordinate, in formulas of coordinates, parameters and the phase of the forcing.
    "equations": {
      "x": "x_dot",
      "x_dot": "-delta * x_dot - alpha * x - beta * x^3 + gamma * cos(phase)"
    },
    "units": { "x": "1", "x_dot": "1/s" },
    "parameters": {
      "delta": { "value": 0.3, "unit": "1/s", "domain": "nonnegative", "description": "damping" },
      "alpha": { "value": -1, "unit": "1/s^2", "description": "linear stiffness" },
      "beta": { "value": 1, "unit": "1/s^2", "description": "cubic stiffness" },
      "gamma": { "value": 0.5, "unit": "1/s^2", "description": "amplitude of the forcing" },
      "omega": { "value": 1.2, "unit": "rad/s", "domain": "positive", "description": "frequency of the forcing" }
    },
    "forcing_phase": "omega"           // phase = omega t; left out where nothing drives the model
  },
)job";

bool is_periodic_task(std::string_view task) {
    return task == "periodic" || task == "search" || task == "continuation";
}

}  // namespace

std::vector<std::string> starting_tasks() {
    return {"simulate", "auto", "cycles", "series", "waveform", "periodic", "search", "continuation"};
}

std::vector<std::string> starting_models() {
    std::vector<std::string> names = model_names();
    names.insert(names.begin(), "equations");
    return names;
}

std::string starting_job(std::string_view model, std::string_view task) {
    const bool equations = model == "equations";
    const auto size = starting_size(model);
    const auto system = models::make_system(equations ? written_out : model, "", size);
    const std::vector<std::string> tasks = starting_tasks();
    if (std::find(tasks.begin(), tasks.end(), task) == tasks.end())
        throw std::invalid_argument(fmt::format("there is no task \"{}\"; tasks: {}", task, fmt::join(tasks, ", ")));
    const bool cycles = is_of_cycles(*system, task);
    if (is_periodic_task(task) && !system->inputs().empty())
        throw std::invalid_argument(
            fmt::format("{} is driven by measured inputs: it has no periodic orbits of its own", model));
    if (cycles && system->kind() == models::Kind::autonomous)
        throw std::invalid_argument(fmt::format("cycles of {}, which is not forced: not in this version", model));
    if (task == "series" && system->kind() == models::Kind::map)
        throw std::invalid_argument(
            fmt::format("series of {}, which is a map: not in this version; estimate from its cycles", model));
    if (task == "waveform" && (system->kind() == models::Kind::map || !system->inputs().empty()))
        throw std::invalid_argument(fmt::format("waveforms of {}, which {}: not in this version", model,
                                                system->inputs().empty() ? "is a map" : "reads measured inputs"));
    std::string text = fmt::format(
        R"(// Check with `orbid check FILE`, run with `orbid run FILE`; {3}.
// `orbid schema > orbid-job.schema.json` tells editors what else may stand here.
{{
  "$schema": "orbid-job.schema.json",
  "title": "{1} of {0}",
{2}  "seed": 1,
)",
        model, task, equations ? std::string(equations_block) : model_block(model, *system, size),
        equations ? "docs/equations.md explains the formulas"
                  : fmt::format("`orbid models {}` explains the model", model));
    if (is_periodic_task(task)) return text + starting_periodic_block(*system, task) + "}\n";
    text += data_block(*system, cycles, size.has_value(), task);
    if (task != "simulate") text += estimate_block(*system, task);
    return text + "  \"output\": { \"series\": \"csv\" }      // h5 | csv | none\n}\n";
}

}  // namespace orbid::apps
