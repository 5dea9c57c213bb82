#include <algorithm>
#include <stdexcept>
#include <tuple>
#include <type_traits>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

/// The density of this form, where it is there.
template <class Density>
void read_density(ObjectReader& object, const describe::DensityForm<Density>& form,
                  std::optional<estimator::Prior>& prior) {
    const auto value = object.find(form.name);
    if (!value) return;
    ObjectReader numbers(*value);
    Density density = form.unset;
    read_fields(numbers, form.fields, density);
    numbers.finish();
    if constexpr (std::is_same_v<Density, estimator::UniformPrior>) {
        if (value->sound() && !(density.lower < density.upper))
            value->report(fmt::format("lower {} must be below upper {}", density.lower, density.upper));
    }
    prior = density;
}

/// Reads { "names", "mean", "covariance" }; what is wrong with single names is reported at them.
std::optional<estimator::JointNormalPrior> read_joint_normal(const ValueReader& value, const Job& job,
                                                             const EstimateJob& estimate,
                                                             std::vector<std::string>& taken) {
    ObjectReader object(value);
    const std::size_t problems_before = value.problem_count();
    const auto names = object.find("names");
    const auto mean = object.find("mean");
    const auto covariance = object.find("covariance");
    object.finish();
    if (!names || !mean || !covariance) return std::nullopt;
    estimator::JointNormalPrior prior;
    const auto known = estimated_parameter_names(job, estimate.parameters);
    for (const ValueReader& item : names->items()) {
        const auto name = item.text();
        if (!name) continue;
        prior.names.push_back(*name);
        if (job.model.system && std::find(known.begin(), known.end(), *name) == known.end()) {
            item.report(fmt::format("\"{}\" is no estimated parameter{}", *name, suggestion(*name, known)));
        } else if (std::find(taken.begin(), taken.end(), *name) != taken.end()) {
            item.report(fmt::format("\"{}\" stands in a joint prior already", *name));
        }
        taken.push_back(*name);
        for (const FreeParameterJob& free : estimate.parameters) {
            if (free.value.name != name->substr(0, name->find('@'))) continue;
            if (!free.value.tied_to.empty()) {
                item.report(fmt::format("{} is tied to {}: name that one", *name, free.value.tied_to));
            } else if (!std::holds_alternative<estimator::FlatPrior>(free.value.prior)) {
                item.report(fmt::format("{} has a prior of its own in \"parameters\"", *name));
            }
        }
    }
    const auto count = static_cast<Eigen::Index>(prior.names.size());
    prior.mean = read_numbers(*mean);
    if (mean->is(JsonValue::Kind::array) && prior.mean.size() != count)
        mean->report(fmt::format("must hold one number per name: {}, not {}", count, prior.mean.size()));
    if (const auto matrix = read_matrix(*covariance, count)) prior.covariance = *matrix;
    // What is wrong already would only be reported a second time in other words.
    if (!value.sound() || value.problem_count() != problems_before) return std::nullopt;
    try {
        estimator::validate(prior);
    } catch (const std::invalid_argument& error) {
        value.report(error.what());
        return std::nullopt;
    }
    return prior;
}

}  // namespace

std::optional<estimator::Prior> read_prior(const ValueReader& value) {
    if (value.is(JsonValue::Kind::string)) {
        if (!value.choice({"flat"})) return std::nullopt;
        return estimator::FlatPrior{};
    }
    ObjectReader object(value);
    std::optional<estimator::Prior> prior;
    std::apply([&](const auto&... form) { (read_density(object, form, prior), ...); }, describe::density_forms());
    object.finish();
    return prior;
}

std::vector<std::string> estimated_parameter_names(const Job& job, const std::vector<FreeParameterJob>& parameters) {
    std::vector<std::string> names;
    for (const FreeParameterJob& free : parameters) {
        const auto has_own = [&](const DataJob& data) { return data.has_own(free.parameter); };
        for (const DataJob& data : job.data)
            if (has_own(data)) names.push_back(free.value.name + "@" + data.name);
        const bool shared = job.data.empty() || !std::all_of(job.data.begin(), job.data.end(), has_own);
        if (shared) names.push_back(free.value.name);
    }
    return names;
}

void read_joint_priors(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    std::vector<std::string> taken;
    for (const ValueReader& item : value.items()) {
        ObjectReader object(item);
        if (const auto normal = object.find("normal")) {
            if (auto prior = read_joint_normal(*normal, job, estimate, taken))
                estimate.joint_priors.push_back(std::move(*prior));
        }
        object.finish();
    }
}

}  // namespace orbid::apps
