#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;

Json choice_document(const ParameterChoice& choice) {
    return choice.names.empty() ? Json(choice.all) : Json(choice.names);
}

Json free_document(const estimator::FreeParameter& free) {
    if (!free.tied_to.empty()) return tie_document(free);
    return {{"start", free.start},
            {"scale", name_of(free.scale, scale_names)},
            {"bounds", bounds_document(free.lower, free.upper)},
            {"prior", prior_document(free.prior)}};
}

Json unknown_document(const periodic::WaveformUnknown& unknown) {
    return unknown.estimate ? Json("estimate") : Json(unknown.value);
}

Json waveform_document(const Job& job, const WaveformResidualJob& waveform) {
    Json object{{"type", "waveform"}, {"data", Json::array()}};
    const bool autonomous = job.model.is(models::Kind::autonomous);
    for (std::size_t i = 0; i < waveform.data.size(); ++i) {
        const WaveformResidualJob::Experiment& experiment = waveform.experiments[i];
        const std::string& name = job.data[waveform.data[i]].name;
        object["data"].push_back(name);
        object[autonomous ? "time" : "period"][name] = autonomous ? Json(experiment.time) : Json(experiment.period);
        object["phase"][name] = unknown_document(experiment.phase);
        if (experiment.start.cols() > 0) object["start"][name] = columns_document(experiment.start);
    }
    // One value for all experiments that observe a coordinate: so they are read.
    object["offset"] = Json::object();
    for (std::size_t c = 0; c < waveform.errors.size(); ++c) {
        const Eigen::Index coordinate = waveform.errors[c].coordinate;
        for (std::size_t i = 0; i < waveform.data.size(); ++i) {
            if (!job.data[waveform.data[i]].observes(coordinate)) continue;
            object["offset"][coordinate_name(job, coordinate)] = unknown_document(waveform.experiments[i].offsets[c]);
            break;
        }
    }
    add_errors(job, waveform.errors, waveform.covariances, object);
    return object;
}

Json matching_document(const MatchingJob& matching) {
    switch (matching.kind) {
        case MatchingJob::Kind::exact:
            return "exact";
        case MatchingJob::Kind::given:
            return {{"sd", matching.sd}};
        case MatchingJob::Kind::estimated:
            return {{"sd", "estimate"}};
        case MatchingJob::Kind::automatic:
            break;
    }
    return "auto";
}

Json interval_document(const std::optional<std::size_t>& interval) {
    if (!interval) return "segment";
    return *interval == SeriesResidualJob::automatic_interval ? Json("auto") : Json(*interval);
}

Json stage_document(const StageJob& stage) {
    if (stage.kind != StageJob::Kind::residuals || stage.residuals.size() == 1) return stage.name();
    return json_list(stage.residuals, [](ResidualType type) { return name_of(type, residual_type_names); });
}

Json criticism_document(const Job& job, const CriticismJob& criticism) {
    Json object = Json::object();
    // An empty list of variants names nothing, and a model that has none refuses the key.
    if (!criticism.variants.empty()) object["variants"] = criticism.variants;
    object["without"] = parameter_list(job, criticism.without);
    object["held_out"] = criticism.held_out;
    return object;
}

Json residuals_document(const Job& job, const EstimateJob& estimate) {
    Json residuals = Json::array();
    if (estimate.cycles) {
        Json cycles{{"type", "cycles"}};
        // Empty: all periods of a file of cycles.
        if (!estimate.cycles->periods.empty()) cycles["periods"] = estimate.cycles->periods;
        cycles["weights"] = estimate.cycles->covariance ? "covariance" : "equal";
        cycles["positions"] = estimate.cycles->positions;
        cycles["multipliers"] = estimate.cycles->multipliers;
        add_errors(job, estimate.cycles->errors, estimate.cycles->covariances, cycles);
        if (estimate.cycles->multipliers)
            cycles["errors"]["ln_multiplier"]["sd"] = scale_document(estimate.cycles->multiplier_error);
        residuals.push_back(std::move(cycles));
    }
    if (estimate.series) {
        Json series{{"type", "series"}};
        series["data"] = json_list(estimate.series->data, [&](std::size_t index) { return job.data[index].name; });
        series["matching"] = matching_document(estimate.series->matching);
        series["interval"] = interval_document(estimate.series->interval);
        add_errors(job, estimate.series->errors, estimate.series->covariances, series);
        residuals.push_back(std::move(series));
    }
    if (estimate.waveform) residuals.push_back(waveform_document(job, *estimate.waveform));
    return residuals;
}

}  // namespace

Json estimate_document(const Job& job) {
    const EstimateJob& estimate = *job.estimate;
    Json object{{"parameters", Json::object()}, {"derived", Json::object()}};
    for (const FreeParameterJob& free : estimate.parameters)
        object["parameters"][free.value.name] = free_document(free.value);
    object["joint_priors"] = joint_priors_document(estimate.joint_priors);
    for (const DerivedJob& derived : estimate.derived)
        object["derived"][derived.name] = derived.expression.text();
    object["residuals"] = residuals_document(job, estimate);
    object["variance"] = name_of(estimate.variance, variance_names);
    object["strategy"] = json_list(estimate.strategy, stage_document);
    if (estimate.scan) object["scan"] = true;
    if (estimate.criticism.any()) object["criticism"] = criticism_document(job, estimate.criticism);
    object["multi_start"] = fields_document(estimate.multi_start, describe::multi_start_fields());
    object["posterior"]["sample"] = fields_document(estimate.sample, describe::sample_fields());
    object["profile"] = choice_document(estimate.profile);
    object["marginals"] = choice_document(estimate.marginals);
    return object;
}

}  // namespace orbid::apps::detail
