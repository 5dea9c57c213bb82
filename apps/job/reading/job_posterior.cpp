#include <algorithm>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

/// What the estimate's parameters are called, so far as it does not depend on data: the several segments of an initial
/// value are named together.
std::vector<std::string> estimated_names(const Job& job, const EstimateJob& estimate) {
    std::vector<FreeParameterJob> leading = estimate.parameters;
    std::erase_if(leading, [](const FreeParameterJob& free) { return !free.value.tied_to.empty(); });
    std::vector<std::string> names = estimated_parameter_names(job, leading);
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

/// Names of the error parameters that are estimated: "series.u.scale", "series.run1.u.dof". Those of a full covariance
/// belong together and have none.
void add_error_names(const Job& job, const std::string& prefix, const std::vector<ErrorJob>& errors,
                     const std::vector<CovarianceJob>& covariances, std::vector<std::string>& names) {
    for (const ErrorJob& error : errors) {
        const bool joint = std::any_of(covariances.begin(), covariances.end(), [&](const CovarianceJob& covariance) {
            return std::count(covariance.coordinates.begin(), covariance.coordinates.end(), error.coordinate) > 0;
        });
        if (joint) continue;
        const std::string group = fmt::format("{}.{}", prefix, job.model.coordinate(error.coordinate).name);
        if (error.scale.estimate) names.push_back(group + ".scale");
        const auto [name, shape] = error_shape(error.distribution);
        if (shape != nullptr && shape->estimate) names.push_back(fmt::format("{}.{}", group, name));
    }
}

std::vector<std::string> error_names(const Job& job, const EstimateJob& estimate) {
    std::vector<std::string> names;
    if (estimate.cycles) {
        add_error_names(job, "cycles", estimate.cycles->errors, estimate.cycles->covariances, names);
        if (estimate.cycles->multipliers && estimate.cycles->multiplier_error.estimate)
            names.emplace_back("cycles.ln_multiplier.scale");
    }
    if (estimate.waveform)
        add_error_names(job, "waveform", estimate.waveform->errors, estimate.waveform->covariances, names);
    if (!estimate.series) return names;
    for (const std::size_t index : estimate.series->data) {
        const DataJob& data = job.data[index];
        std::vector<ErrorJob> own;
        for (const ErrorJob& error : estimate.series->errors)
            if (data.observes(error.coordinate)) own.push_back(error);
        const bool single = estimate.series->data.size() == 1;
        add_error_names(job, single ? "series" : "series." + data.name, own, estimate.series->covariances, names);
    }
    return names;
}

/// true, false, or a list of estimated parameters.
ParameterChoice read_choice(const ValueReader& value, const Job& job, const EstimateJob& estimate) {
    ParameterChoice choice;
    if (value.is(JsonValue::Kind::boolean)) {
        choice.all = value.value().boolean;
    } else if (value.is(JsonValue::Kind::array)) {
        auto known = estimated_names(job, estimate);
        const auto errors = job.model.system ? error_names(job, estimate) : std::vector<std::string>{};
        known.insert(known.end(), errors.begin(), errors.end());
        for (const auto& [name, item] : read_names(value)) {
            choice.names.push_back(name);
            if (!job.model.system || std::find(known.begin(), known.end(), name) != known.end()) continue;
            item.report(fmt::format("\"{}\" is not estimated{}", name, suggestion(name, known)));
        }
    }
    if (choice.all && job.model.system && estimated_names(job, estimate).empty() &&
        error_names(job, estimate).empty()) {
        value.report("nothing is estimated");
    }
    return choice;
}

void read_sample(const ValueReader& value, SampleJob& sample) {
    if (value.is(JsonValue::Kind::number)) return value.read(sample.draws);
    ObjectReader object(value);
    read_fields(object, describe::sample_fields(), sample);
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
        read_fields(inner, describe::multi_start_fields(), estimate.multi_start);
        if (estimate.multi_start.starts > 1 && estimate.strategy.size() > 1)
            inner.find("starts")->report("several starts go with one stage; the stages of a strategy find their own");
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
