#include <algorithm>

#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps {

bool ParameterChoice::contains(const std::string& name) const {
    return all || std::any_of(names.begin(), names.end(), [&](const std::string& chosen) {
               return name == chosen || (chosen.find('@') != std::string::npos && name.starts_with(chosen + "."));
           });
}

namespace describe {

namespace {

using Json = nlohmann::ordered_json;

// More than anybody waits for; keeps a slip of the pen from filling memory.
constexpr double most_starts = 100000;
constexpr double most_draws = 1e7;
constexpr double most_chains = 1000;

const FieldTable<SampleJob>& sample_fields() {
    static const FieldTable<SampleJob> table{
        open_field(key("draws", whole(0, most_draws), "Per chain, after the warm-up.").required_always(),
                   &SampleJob::draws),
        field(key("chains", whole(2, most_chains), "Their agreement is the test."), &SampleJob::chains),
        field(key("warm_up", whole(1, most_draws), "Draws that tune the sampler."), &SampleJob::warm_up)};
    return table;
}

const FieldTable<EstimateJob>& posterior_fields() {
    const auto keys = keys_of(sample_fields());
    static const FieldTable<EstimateJob> table{
        {key("sample", keys.front().value | object(keys), "Draws by the No-U-Turn sampler.").by_default(0),
         [](const ValueReader& value, const Job& job, EstimateJob& estimate) {
             read_short_or_object(value, "draws", sample_fields(), estimate.sample, job);
         },
         [](const EstimateJob& estimate, const Writing& at) {
             return fields_document(estimate.sample, sample_fields(), at);
         }}};
    return table;
}

void check_replicates(const ValueReader& bootstrap, const Job&, IntervalsJob& intervals) {
    if (intervals.bootstrap == 0 || intervals.bootstrap >= IntervalsJob::least) return;
    bootstrap.report(
        fmt::format("must be 0 or at least {}, not {}: the ends of a 95 % interval lie beyond the values "
                    "of fewer replicates",
                    IntervalsJob::least, intervals.bootstrap));
}

const FieldTable<IntervalsJob>& interval_fields() {
    static const FieldTable<IntervalsJob> table{
        field(key("bootstrap", whole(0, most_starts),
                  "Records drawn anew from the estimate and estimated again, beginning at it: 0, or 40 and more."),
              &IntervalsJob::bootstrap)
            .with_rule(check_replicates),
        choice_field(key("kind", {},
                         "Errors of new records: of the estimated laws, or the residuals in blocks; \"auto\": blocks "
                         "where residuals are correlated beyond what their law says."),
                     {"auto", "parametric", "blocks"}, &IntervalsJob::kind)};
    return table;
}

const FieldTable<MultiStartJob>& multi_start_fields() {
    static const FieldTable<MultiStartJob> table{
        field(key("starts", whole(1, most_starts), "The job's and random ones."), &MultiStartJob::starts),
        open_field(key("seed", seed(), "Of the random starts; the job's unless given."), &MultiStartJob::seed)};
    return table;
}

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
        if (estimate.cycles->times && estimate.cycles->time_error.estimate) names.emplace_back("cycles.time.scale");
    }
    if (estimate.waveform)
        add_error_names(job, "waveform", estimate.waveform->errors, estimate.waveform->covariances, names);
    if (estimate.branch)
        for (const BranchResidualJob::Measure& one : estimate.branch->measures)
            if (one.error.scale.estimate)
                names.push_back("branch." +
                                estimate.branch->measure_name(*job.model.system, one.measure, one.column.coordinate) +
                                ".scale");
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

/// All that is estimated, by name.
std::vector<std::string> all_estimated(const Job& job, const EstimateJob& estimate) {
    if (!job.model.system) return {};
    auto names = estimated_names(job, estimate);
    const auto errors = error_names(job, estimate);
    names.insert(names.end(), errors.begin(), errors.end());
    return names;
}

/// true, false, or a list of estimated parameters.
Field<EstimateJob> parameter_choice_field(const char* name, const char* description,
                                          ParameterChoice EstimateJob::*member) {
    return {key(name, boolean() | names(), description).by_default(false),
            [member](const ValueReader& value, const Job& job, EstimateJob& estimate) {
                ParameterChoice& choice = estimate.*member;
                const auto known = all_estimated(job, estimate);
                if (value.is(JsonValue::Kind::boolean)) choice.all = value.value().boolean;
                if (choice.all && job.model.system && known.empty()) value.report("nothing is estimated");
                if (!value.is(JsonValue::Kind::array)) return;
                for (const auto& [parameter, item] : read_names(value)) {
                    choice.names.push_back(parameter);
                    if (job.model.system && !is_in(parameter, known))
                        item.report(fmt::format("\"{}\" is not estimated{}", parameter, suggestion(parameter, known)));
                }
            },
            [member](const EstimateJob& estimate, const Writing&) {
                const ParameterChoice& choice = estimate.*member;
                return choice.names.empty() ? Json(choice.all) : Json(choice.names);
            }};
}

}  // namespace

void add_posterior_fields(FieldTable<EstimateJob>& table) {
    table.push_back(object_field<EstimateJob>(
        key("multi_start", {}, "Every stage but a prediction estimates from several starts; the best goes on."),
        multi_start_fields(), &EstimateJob::multi_start));
    table.push_back(object_field<EstimateJob>(key("posterior", {}, "Draws from the posterior density."),
                                              posterior_fields(), std::identity{}));
    table.push_back(object_field<EstimateJob>(key("intervals", {}, "Intervals by simulation (bootstrap)."),
                                              interval_fields(), &EstimateJob::intervals));
    table.push_back(parameter_choice_field("profile", "Likelihood intervals of all parameters, or of those named.",
                                           &EstimateJob::profile));
    table.push_back(parameter_choice_field(
        "marginals", "Densities with all else integrated out, of all or of those named.", &EstimateJob::marginals));
}

}  // namespace describe

}  // namespace orbid::apps
