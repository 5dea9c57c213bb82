#include <type_traits>
#include <variant>

#include "apps/documents/json_text.hpp"
#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

using Json = nlohmann::ordered_json;

std::string_view scale_name(estimator::Scale scale) {
    switch (scale) {
        case estimator::Scale::log:
            return "log";
        case estimator::Scale::log10:
            return "log10";
        case estimator::Scale::logit:
            return "logit";
        case estimator::Scale::linear:
            break;
    }
    return "linear";
}

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
            } else if constexpr (std::is_same_v<Density, estimator::HalfNormalPrior>) {
                return {{"half_normal", {{"scale", density.scale}}}};
            } else if constexpr (std::is_same_v<Density, estimator::HalfCauchyPrior>) {
                return {{"half_cauchy", {{"scale", density.scale}}}};
            } else if constexpr (std::is_same_v<Density, estimator::GammaPrior>) {
                return {{"gamma", {{"shape", density.shape}, {"rate", density.rate}}}};
            } else if constexpr (std::is_same_v<Density, estimator::StudentPrior>) {
                return {
                    {"student_t", {{"dof", density.dof}, {"location", density.location}, {"scale", density.scale}}}};
            } else {
                static_assert(std::is_same_v<Density, estimator::FlatPrior>);
                return "flat";
            }
        },
        prior);
}

Json joint_priors_document(const std::vector<estimator::JointNormalPrior>& priors) {
    Json list = Json::array();
    for (const estimator::JointNormalPrior& prior : priors) {
        Json normal{{"names", prior.names}, {"mean", Json::array()}, {"covariance", json_rows(prior.covariance)}};
        for (const double mean : prior.mean)
            normal["mean"].push_back(mean);
        list.push_back({{"normal", std::move(normal)}});
    }
    return list;
}

Json tie_document(const estimator::FreeParameter& parameter) {
    return {{"tied", {{"to", parameter.tied_to}, {"factor", parameter.tie_factor}}}};
}

}  // namespace orbid::apps::detail
