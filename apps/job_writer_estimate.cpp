#include <cmath>
#include <type_traits>
#include <variant>

#include "apps/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;

Json bound_document(double bound) {
    return std::isfinite(bound) ? Json(bound) : Json(nullptr);
}

Json free_document(const estimator::FreeParameter& free) {
    return {{"start", free.start},
            {"scale", free.scale == estimator::Scale::log ? "log" : "linear"},
            {"bounds", Json::array({bound_document(free.lower), bound_document(free.upper)})},
            {"prior", prior_document(free.prior)}};
}

Json errors_document(const Job& job, const std::vector<ErrorJob>& errors) {
    Json object = Json::object();
    for (const ErrorJob& error : errors) {
        Json sd = error.scale.value;
        if (error.scale.estimate) {
            Json options = Json::object();
            if (error.scale.value > 0) options["start"] = error.scale.value;
            options["prior"] = prior_document(error.scale.prior);
            sd = {{"estimate", std::move(options)}};
        }
        object[coordinate_name(job, error.coordinate)] = {{"distribution", "normal"}, {"sd", std::move(sd)}};
    }
    return object;
}

Json residuals_document(const Job& job, const EstimateJob& estimate) {
    Json residuals = Json::array();
    if (estimate.cycles) {
        Json cycles{{"type", "cycles"}};
        // Empty: all periods of a file of cycles.
        if (!estimate.cycles->periods.empty()) cycles["periods"] = estimate.cycles->periods;
        cycles["weights"] = estimate.cycles->covariance ? "covariance" : "equal";
        cycles["positions"] = true;
        cycles["multipliers"] = false;
        cycles["errors"] = errors_document(job, estimate.cycles->errors);
        residuals.push_back(std::move(cycles));
    }
    if (estimate.series) {
        Json series{{"type", "series"}, {"data", Json::array()}};
        for (const std::size_t index : estimate.series->data)
            series["data"].push_back(job.data[index].name);
        series["matching"] = "exact";
        // What "auto" means in this version: a later one may choose otherwise, this job may not.
        series["interval"] = "segment";
        series["errors"] = errors_document(job, estimate.series->errors);
        residuals.push_back(std::move(series));
    }
    return residuals;
}

}  // namespace

Json prior_document(const estimator::Prior& prior) {
    return std::visit(
        [](const auto& density) -> Json {
            using Density = std::decay_t<decltype(density)>;
            if constexpr (std::is_same_v<Density, estimator::NormalPrior>) {
                return {{"normal", {{"mean", density.mean}, {"sd", density.sd}}}};
            } else if constexpr (std::is_same_v<Density, estimator::LogNormalPrior>) {
                return {{"lognormal", {{"median", density.median}, {"log_sd", density.log_sd}}}};
            } else if constexpr (std::is_same_v<Density, estimator::UniformPrior>) {
                return {{"uniform", {{"lower", density.lower}, {"upper", density.upper}}}};
            } else {
                return "flat";
            }
        },
        prior);
}

Json estimate_document(const Job& job) {
    const EstimateJob& estimate = *job.estimate;
    Json object{{"parameters", Json::object()}, {"derived", Json::object()}};
    for (const FreeParameterJob& free : estimate.parameters) {
        object["parameters"][free.value.name] = free_document(free.value);
    }
    for (const DerivedJob& derived : estimate.derived)
        object["derived"][derived.name] = derived.expression.text();
    object["residuals"] = residuals_document(job, estimate);
    object["variance"] = estimate.variance == estimator::Variance::ml ? "ml" : "restricted";
    object["strategy"] = Json::array();
    for (const ResidualType type : estimate.strategy) {
        object["strategy"].push_back(type == ResidualType::cycles ? "cycles" : "series");
    }
    object["multi_start"] = {{"starts", 1}};
    object["posterior"] = {{"sample", 0}};
    return object;
}

}  // namespace orbid::apps::detail
