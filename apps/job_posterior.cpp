#include <algorithm>

#include "apps/job_parts.hpp"

namespace orbid::apps {

namespace {

// More than anybody waits for; keeps a slip of the pen from filling memory.
constexpr std::uint64_t most_starts = 100000;
constexpr std::uint64_t most_draws = 10000000;
constexpr std::uint64_t most_chains = 1000;

/// What the estimate's parameters are called, so far as it does not depend on data: the several segments of an initial
/// value are named together.
std::vector<std::string> estimated_names(const Job& job, const EstimateJob& estimate) {
    std::vector<std::string> names;
    for (const FreeParameterJob& free : estimate.parameters) {
        const auto has_own = [&](const DataJob& data) {
            return std::find(data.free.begin(), data.free.end(), free.parameter) != data.free.end();
        };
        for (const DataJob& data : job.data) {
            if (has_own(data)) names.push_back(free.value.name + "@" + data.name);
        }
        const bool shared = job.data.empty() || !std::all_of(job.data.begin(), job.data.end(), has_own);
        if (shared) names.push_back(free.value.name);
    }
    if (!estimate.series) return names;
    for (const std::size_t index : estimate.series->data) {
        const DataJob& data = job.data[index];
        for (std::size_t i = 0; i < data.initial_state.size(); ++i) {
            if (!data.initial_state[i].is_parameter()) continue;
            names.push_back(initial_parameter_name(coordinate_names(job)[i], data.name));
        }
    }
    return names;
}

/// true, false, or a list of estimated parameters.
ParameterChoice read_choice(const ValueReader& value, const Job& job, const EstimateJob& estimate) {
    ParameterChoice choice;
    if (value.is(JsonValue::Kind::boolean)) {
        choice.all = value.value().boolean;
    } else if (value.is(JsonValue::Kind::array)) {
        choice.names = read_names(value);
        const auto known = estimated_names(job, estimate);
        for (const std::string& name : choice.names) {
            if (!job.model.system || std::find(known.begin(), known.end(), name) != known.end()) continue;
            value.report(fmt::format("\"{}\" is no estimated parameter{}", name, suggestion(name, known)));
        }
    } else {
        value.report_kind("true, false or a list of estimated parameters");
    }
    if (choice.any() && job.model.system && estimated_names(job, estimate).empty()) {
        value.report("there is no estimated parameter");
    }
    return choice;
}

void read_sample(const ValueReader& value, SampleJob& sample) {
    if (value.is(JsonValue::Kind::number)) {
        sample.draws = value.whole(0, most_draws).value_or(0);
        return;
    }
    if (!value.is(JsonValue::Kind::object)) {
        value.report_kind("a number of draws, or { \"draws\": ..., \"chains\": ..., \"warm_up\": ... }");
        return;
    }
    ObjectReader object(value);
    if (const auto draws = object.require("draws", "how many per chain")) {
        sample.draws = draws->whole(0, most_draws).value_or(0);
    }
    // Agreement of chains is the only sign that they found the same density.
    if (const auto chains = object.find("chains")) sample.chains = chains->whole(2, most_chains).value_or(2);
    if (const auto warm_up = object.find("warm_up")) sample.warm_up = warm_up->whole(1, most_draws).value_or(1);
    object.finish();
}

}  // namespace

bool ParameterChoice::contains(const std::string& name) const {
    return all || std::any_of(names.begin(), names.end(), [&](const std::string& chosen) {
               return name == chosen || (chosen.find('@') != std::string::npos && name.starts_with(chosen + "."));
           });
}

void read_posterior(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    estimate.multi_start.seed = job.seed;
    if (const auto value = object.find("multi_start")) {
        ObjectReader inner(*value);
        if (const auto starts = inner.find("starts")) {
            estimate.multi_start.starts = starts->whole(1, most_starts).value_or(1);
        }
        if (const auto seed = inner.find("seed")) {
            estimate.multi_start.seed = seed->whole(0, largest_exact_whole).value_or(job.seed);
        }
        inner.finish();
    }
    if (const auto value = object.find("posterior")) {
        ObjectReader inner(*value);
        if (const auto sample = inner.find("sample")) read_sample(*sample, estimate.sample);
        inner.finish();
    }
    if (const auto value = object.find("profile")) estimate.profile = read_choice(*value, job, estimate);
    if (const auto value = object.find("marginals")) estimate.marginals = read_choice(*value, job, estimate);
}

}  // namespace orbid::apps
