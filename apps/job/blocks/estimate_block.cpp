#include <algorithm>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps {

namespace describe {

namespace {

using Json = nlohmann::ordered_json;

void read_derived(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    const std::vector<std::string> parameters = parameter_names(job);
    for (const auto& [name, member] : value.members()) {
        const auto formula = member.text();
        if (!is_name(name, member) || !formula) continue;
        if (is_in(name, parameters)) member.report(fmt::format("\"{}\" is a parameter of the model already", name));
        if (!job.model.system) continue;
        try {
            estimate.derived.push_back({name, models::Expression::parse(*formula, parameters)});
        } catch (const models::ExpressionError& error) {
            member.report_character(error.position, error.what());
            // Named all the same, so that its reference value is not called unknown.
            estimate.derived.push_back({name, {}});
        }
    }
}

Field<EstimateJob> derived_field() {
    return {key("derived", entries(text(), "a derived quantity"),
                "Formulas of parameters whose values and intervals are shown: { \"k_over_m\": \"k / m\" }.")
                .standard_text("{}"),
            read_derived, [](const EstimateJob& estimate, const Writing&) {
                Json object = Json::object();
                for (const DerivedJob& derived : estimate.derived)
                    object[derived.name] = derived.expression.text();
                return object;
            }};
}

/// Whether a period is to be told from a record, so that nothing is known of the motion but its readings.
bool begins_at_records(const Job& job, const WaveformResidualJob& waveform) {
    return job.model.is(models::Kind::autonomous) && !waveform.of_cycles &&
           std::any_of(
               waveform.experiments.begin(), waveform.experiments.end(),
               [](const WaveformResidualJob::Experiment& one) { return one.time == 0.0 && one.start.size() == 0; });
}

/// The errors of waveforms, as a series with nodes has them.
std::vector<ErrorJob> errors_at_nodes(const Job& job, const WaveformResidualJob& waveform) {
    std::vector<ErrorJob> errors = waveform.errors;
    for (const std::size_t index : waveform.data) {
        const models::Sensor& sensor = job.data[index].sensor;
        if (sensor.type != models::Sensor::Type::angle_difference) continue;
        std::erase_if(errors,
                      [&](const ErrorJob& one) { return one.coordinate == static_cast<Eigen::Index>(sensor.rate); });
    }
    for (ErrorJob& one : errors)
        if (std::holds_alternative<estimator::AutoregressiveErrors>(one.distribution))
            one.distribution = estimator::NormalErrors{};
    return errors;
}

/// With process noise states are integrated out while parameters are estimated, and only there.
void check_process_noise(ObjectReader& object, const EstimateJob& estimate) {
    if (!estimate.series || estimate.series->matching.kind != MatchingJob::Kind::diffusion) return;
    const auto refuse = [&](bool asked, const char* key) {
        if (asked)
            object.find(key)->report(
                fmt::format("does not go with process noise ({}): leave out one of the two", not_in_this_version));
    };
    refuse(estimate.profile.any(), "profile");
    refuse(estimate.marginals.any(), "marginals");
    refuse(estimate.sample.draws > 0, "posterior");
    refuse(estimate.intervals.bootstrap > 0, "intervals");
    refuse(!estimate.joint_priors.empty(), "joint_priors");
    for (const FreeParameterJob& free : estimate.parameters)
        if (estimator::is_proper(free.value.prior))
            object.find("parameters")
                ->report(fmt::format("a prior of {} does not go with process noise ({}): use \"bounds\"",
                                     free.value.name, not_in_this_version));
}

}  // namespace

void add_waveform_start(const Job& job, EstimateJob& estimate) {
    if (!estimate.waveform || estimate.residual_types().size() > 1 || !begins_at_records(job, *estimate.waveform))
        return;
    SeriesResidualJob series;
    series.data = estimate.waveform->data;
    series.errors = errors_at_nodes(job, *estimate.waveform);
    series.interval = SeriesResidualJob::automatic_interval;
    estimate.series = std::move(series);
    estimate.strategy = {{StageJob::Kind::residuals, {ResidualType::series}},
                         {StageJob::Kind::residuals, {ResidualType::waveform}}};
}

const FieldTable<EstimateJob>& estimate_fields() {
    static const FieldTable<EstimateJob> table = [] {
        FieldTable<EstimateJob> fields{
            parameters_field(), joint_priors_field().written_after("derived"), derived_field(), residuals_field(),
            choice_field(
                key("variance", {},
                    "How error scales are estimated: maximum likelihood, restricted likelihood, or integrated out."),
                variance_names, &EstimateJob::variance)};
        add_strategy_fields(fields);
        add_posterior_fields(fields);
        fields.push_back(criticism_field().written_after("scan"));
        return fields;
    }();
    return table;
}

}  // namespace describe

void read_estimate(ObjectReader& root, Job& job) {
    const auto value = root.find("estimate");
    if (!value) {
        for (const DataJob& data : job.data)
            if (!data.free.empty()) root.self().report(fmt::format("\"free\" in \"{}\" needs \"estimate\"", data.name));
        return;
    }
    EstimateJob estimate;
    estimate.multi_start.seed = job.seed;
    ObjectReader object(*value);
    const auto strategy = object.find("strategy");
    estimate.automatic = strategy && strategy->is(JsonValue::Kind::string) && strategy->value().text == "auto";
    if (!object.find("residuals")) {
        if (estimate.automatic) {
            estimate.usual_residuals = true;
            describe::add_usual_residuals(*strategy, job, estimate);
        } else {
            (void)object.require("residuals",
                                 "[ { \"type\": \"cycles\" } ], for example; with \"strategy\": \"auto\" not needed");
        }
    }
    read_fields(object, describe::estimate_fields(), estimate, job);
    describe::check_process_noise(object, estimate);
    object.finish();
    if (!strategy) describe::add_waveform_start(job, estimate);
    job.estimate = std::move(estimate);
}

}  // namespace orbid::apps
