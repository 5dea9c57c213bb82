#include <type_traits>
#include <variant>

#include "apps/documents/json_text.hpp"
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

Json shape_document(const estimator::ErrorParameter& parameter) {
    return value_document(parameter.estimate, parameter.value, true, parameter.prior);
}

void add_distribution(const estimator::ErrorDistribution& distribution, Json& object) {
    std::visit(
        [&object](const auto& errors) {
            using Errors = std::decay_t<decltype(errors)>;
            if constexpr (std::is_same_v<Errors, estimator::NormalErrors>) {
                object["distribution"] = "normal";
            } else if constexpr (std::is_same_v<Errors, estimator::StudentErrors>) {
                object["distribution"] = "student_t";
                object["dof"] = shape_document(errors.dof);
            } else if constexpr (std::is_same_v<Errors, estimator::LaplaceErrors>) {
                object["distribution"] = "laplace";
            } else if constexpr (std::is_same_v<Errors, estimator::LogNormalErrors>) {
                object["distribution"] = "lognormal";
            } else if constexpr (std::is_same_v<Errors, estimator::RelativeErrors>) {
                object["distribution"] = "relative";
                object["relative"] = shape_document(errors.relative);
            } else {
                static_assert(std::is_same_v<Errors, estimator::AutoregressiveErrors>);
                object["distribution"] = "ar1";
                object["correlation"] = shape_document(errors.correlation);
            }
        },
        distribution);
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
        Json of = Json::array();
        for (const Eigen::Index coordinate : covariance.coordinates)
            of.push_back(coordinate_name(job, coordinate));
        residual["covariance"] = {{"of", std::move(of)}};
        if (covariance.dof > 0.0) {
            residual["covariance"]["prior"] = {
                {"inverse_wishart", {{"dof", covariance.dof}, {"matrix", json_rows(covariance.psi)}}}};
        }
    }
}

}  // namespace orbid::apps::detail
