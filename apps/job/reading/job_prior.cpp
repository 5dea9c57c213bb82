#include <algorithm>
#include <array>
#include <stdexcept>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

/// The numbers of one density.
class DensityReader {
public:
    explicit DensityReader(const ValueReader& value) : object_(value) {}

    /// 1 where it is missing or refused: every density allows it.
    double number(std::string_view key) {
        const auto entry = object_.find(key);
        return entry ? entry->number().value_or(1.0) : 1.0;
    }
    void finish() const { object_.finish(); }

private:
    ObjectReader object_;
};

std::optional<estimator::Prior> read_density(const std::string& form, const ValueReader& value) {
    DensityReader density(value);
    std::optional<estimator::Prior> prior;
    if (form == "normal") {
        const double mean = density.number("mean");
        prior = estimator::NormalPrior{mean, density.number("sd")};
    } else if (form == "lognormal") {
        const double median = density.number("median");
        prior = estimator::LogNormalPrior{median, density.number("log_sd")};
    } else if (form == "uniform") {
        const double lower = density.number("lower");
        const double upper = density.number("upper");
        if (value.sound() && !(lower < upper))
            value.report(fmt::format("lower {} must be below upper {}", lower, upper));
        prior = estimator::UniformPrior{lower, upper};
    } else if (form == "half_normal") {
        prior = estimator::HalfNormalPrior{density.number("scale")};
    } else if (form == "half_cauchy") {
        prior = estimator::HalfCauchyPrior{density.number("scale")};
    } else if (form == "gamma") {
        const double shape = density.number("shape");
        prior = estimator::GammaPrior{shape, density.number("rate")};
    } else {
        const double dof = density.number("dof");
        const double location = density.number("location");
        prior = estimator::StudentPrior{dof, location, density.number("scale")};
    }
    density.finish();
    return prior;
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
    const auto known = estimated_parameter_names(job, estimate);
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
    const auto means = mean->items();
    if (mean->is(JsonValue::Kind::array) && means.size() != prior.names.size())
        mean->report(fmt::format("must hold one number per name: {}, not {}", count, means.size()));
    prior.mean.resize(static_cast<Eigen::Index>(means.size()));
    for (std::size_t i = 0; i < means.size(); ++i)
        prior.mean[static_cast<Eigen::Index>(i)] = means[i].number().value_or(0.0);
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
    for (const char* form : {"normal", "lognormal", "uniform", "half_normal", "half_cauchy", "gamma", "student_t"})
        if (const auto density = object.find(form)) prior = read_density(form, *density);
    object.finish();
    return prior;
}

std::optional<estimator::Scale> read_scale(const ValueReader& value) {
    using estimator::Scale;
    const auto choice = value.choice({"linear", "log", "log10", "logit"});
    if (!choice) return std::nullopt;
    constexpr std::array scales{Scale::linear, Scale::log, Scale::log10, Scale::logit};
    return scales[*choice];
}

std::vector<std::string> estimated_parameter_names(const Job& job, const EstimateJob& estimate) {
    std::vector<std::string> names;
    for (const FreeParameterJob& free : estimate.parameters) {
        const auto has_own = [&](const DataJob& data) {
            return std::find(data.free.begin(), data.free.end(), free.parameter) != data.free.end();
        };
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
