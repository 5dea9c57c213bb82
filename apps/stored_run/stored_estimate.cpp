#include "apps/stored_run/stored_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "apps/job/estimate_job.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

/// The scale and the bounds on which a parameter was estimated, as job.json has them.
estimator::FreeParameter stored_scale(const StoredRun& run, const std::string& model_name) {
    estimator::FreeParameter free;
    free.name = model_name;
    const auto pointer = Json::json_pointer("/estimate/parameters/" + model_name);
    if (!run.job.contains(pointer)) return free;
    const Json& entry = run.job.at(pointer);
    const std::string scale = entry.value("scale", std::string("linear"));
    for (std::size_t i = 0; i < scale_names.size(); ++i)
        if (scale_names[i] == scale) free.scale = static_cast<estimator::Scale>(i);
    if (entry.contains("bounds") && entry["bounds"].is_array() && entry["bounds"].size() == 2) {
        if (entry["bounds"][0].is_number()) free.lower = entry["bounds"][0].get<double>();
        if (entry["bounds"][1].is_number()) free.upper = entry["bounds"][1].get<double>();
    }
    return free;
}

Eigen::MatrixXd covariance_of(const Json& result, const std::vector<StoredEstimate>& estimates) {
    const auto pointer = Json::json_pointer("/covariance/matrix");
    if (!result.contains(pointer)) return {};
    const Json& matrix = result.at(pointer);
    const auto count = std::ssize(estimates);
    Eigen::MatrixXd covariance(count, count);
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index j = 0; j < count; ++j) {
            const std::size_t a = estimates[static_cast<std::size_t>(i)].row;
            const std::size_t b = estimates[static_cast<std::size_t>(j)].row;
            // A direction that the data do not determine has no covariance.
            if (a >= matrix.size() || b >= matrix[a].size() || !matrix[a][b].is_number()) return {};
            covariance(i, j) = matrix[a][b].get<double>();
        }
    return covariance;
}

Eigen::MatrixXd sample_of(const StoredRun& run, const std::vector<StoredEstimate>& estimates) {
    const auto draws = stored_draws(run);
    if (!draws || draws->chain.empty()) return {};
    Eigen::MatrixXd sample(std::ssize(estimates), std::ssize(draws->chain));
    for (std::size_t i = 0; i < estimates.size(); ++i) {
        const auto found = std::find(draws->names.begin(), draws->names.end(), estimates[i].name);
        if (found == draws->names.end()) return {};
        const auto& column = draws->columns[static_cast<std::size_t>(found - draws->names.begin())];
        sample.row(static_cast<Eigen::Index>(i)) =
            Eigen::Map<const Eigen::RowVectorXd>(column.data(), std::ssize(column));
    }
    return sample;
}

}  // namespace

namespace detail {

double stored_value(const Json& entry) {
    const Json& value = entry.is_object() && entry.contains("value") ? entry["value"] : entry;
    return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace detail

std::vector<StoredEstimate> stored_estimates(const StoredRun& run, const Json& parameters,
                                             const std::string& experiment) {
    std::vector<StoredEstimate> estimates;
    std::string own;
    std::size_t row = 0;
    for (const auto& [name, entry] : run.result->at("parameters").items()) {
        const StoredEstimate estimate{name.substr(0, name.find('@')), name, row++, detail::stored_value(entry),
                                      entry.is_object() && entry.contains("held")};
        // A value at the beginning of a record is no parameter of the model.
        if (!parameters.contains(estimate.model_name) || !std::isfinite(estimate.value)) continue;
        const auto at = name.find('@');
        if (at != std::string::npos && name.substr(at + 1) != experiment) {
            own = name;
            continue;
        }
        estimates.push_back(estimate);
    }
    if (!own.empty() && experiment.empty())
        throw StoredRunRefused(
            fmt::format("{}: {} and others are estimated per experiment: say by --experiment whose values hold",
                        run.folder.string(), own));
    if (estimates.empty())
        throw StoredRunRefused(fmt::format("{}: holds no estimate of a parameter of the model", run.folder.string()));
    return estimates;
}

identification::ParameterPosterior stored_posterior(const StoredRun& run, const ModelJob& model,
                                                    const std::vector<StoredEstimate>& estimates, bool draws) {
    identification::ParameterPosterior posterior;
    posterior.values = model.values;
    for (const StoredEstimate& one : estimates) {
        posterior.parameters.push_back(model.system->parameter_index(one.model_name));
        posterior.estimated.push_back(stored_scale(run, one.model_name));
    }
    posterior.covariance = covariance_of(*run.result, estimates);
    if (draws) posterior.sample = sample_of(run, estimates);
    if (posterior.covariance.size() > 0 || posterior.sample.size() > 0 || estimates.empty()) return posterior;
    throw StoredRunRefused(fmt::format(
        "{}: the estimate has no covariance, since the data do not determine all its parameters: hold some of them by "
        "\"parameters\" of the question{}",
        run.folder.string(),
        draws ? ", or draw from the posterior in the run (\"posterior\": { \"sample\": ... })" : ""));
}

}  // namespace orbid::apps
