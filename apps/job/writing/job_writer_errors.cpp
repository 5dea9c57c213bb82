#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;

/// A number, or { "estimate": { "start", "prior" } }.
Json value_document(bool estimate, double value, bool has_start, const estimator::Prior& prior) {
    if (!estimate) return value;
    Json options = Json::object();
    if (has_start) options["start"] = value;
    options["prior"] = prior_document(prior);
    return {{"estimate", std::move(options)}};
}

void add_distribution(const estimator::ErrorDistribution& distribution, Json& object) {
    object["distribution"] = name_of(distribution.index(), distribution_names);
    const auto [key, shape] = error_shape(distribution);
    if (shape != nullptr) object[key] = value_document(shape->estimate, shape->value, true, shape->prior);
}

}  // namespace

nlohmann::ordered_json scale_document(const estimator::ErrorScale& scale) {
    // <= 0 while estimated: from the residuals.
    return value_document(scale.estimate, scale.value, scale.value > 0.0, scale.prior);
}

void add_errors(const Job& job, const std::vector<ErrorJob>& errors, const std::vector<CovarianceJob>& covariances,
                Json& residual) {
    Json object = Json::object();
    for (const ErrorJob& error : errors) {
        Json entry = Json::object();
        add_distribution(error.distribution, entry);
        Json sd = scale_document(error.scale);
        if (error.sd_column.empty()) {
            entry["sd"] = std::move(sd);
        } else {
            entry["sd"] = {{"column", error.sd_column}, {"factor", std::move(sd)}};
        }
        if (error.floor > 0.0) entry["floor"] = error.floor;
        object[coordinate_name(job, error.coordinate)] = std::move(entry);
    }
    residual["errors"] = std::move(object);
    // The reader knows one covariance per residual.
    for (const CovarianceJob& covariance : covariances) {
        residual["covariance"]["of"] = coordinate_list(job, covariance.coordinates);
        if (covariance.dof > 0.0) {
            residual["covariance"]["prior"] = {
                {"inverse_wishart", {{"dof", covariance.dof}, {"matrix", json_rows(covariance.psi)}}}};
        }
    }
}

Json joint_priors_document(const std::vector<estimator::JointNormalPrior>& priors) {
    return json_list(priors, [](const estimator::JointNormalPrior& prior) -> Json {
        return {
            {"normal",
             {{"names", prior.names}, {"mean", json_list(prior.mean)}, {"covariance", json_rows(prior.covariance)}}}};
    });
}

Json tie_document(const estimator::FreeParameter& parameter) {
    return {{"tied", {{"to", parameter.tied_to}, {"factor", parameter.tie_factor}}}};
}

}  // namespace orbid::apps::detail
