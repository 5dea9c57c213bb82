#include <cmath>

#include "apps/job_parts.hpp"

namespace orbid::apps {

namespace {

constexpr std::string_view prior_forms =
    "\"flat\", or an object with one of \"normal\": { mean, sd }, \"lognormal\": { median, log_sd }, "
    "\"uniform\": { lower, upper }";

/// The two numbers of a density.
struct Pair {
    double first = 0.0;
    double second = 1.0;
};

Pair read_pair(const ValueReader& value, std::string_view first, std::string_view second, bool first_positive,
               bool second_positive) {
    Pair pair;
    ObjectReader object(value);
    const auto read = [&](std::string_view key, bool positive, double& target) {
        const auto entry = object.require(key, positive ? "a number > 0" : "a number");
        if (!entry) return;
        const auto number = positive ? entry->positive() : entry->number();
        if (number) target = *number;
    };
    read(first, first_positive, pair.first);
    read(second, second_positive, pair.second);
    object.finish();
    return pair;
}

}  // namespace

std::optional<estimator::Prior> read_prior(const ValueReader& value) {
    if (value.is(JsonValue::Kind::string)) {
        if (!value.choice({"flat"})) return std::nullopt;
        return estimator::FlatPrior{};
    }
    if (!value.is(JsonValue::Kind::object) || value.value().members.size() > 1) {
        value.report(fmt::format("must be {}", prior_forms));
        return std::nullopt;
    }
    ObjectReader object(value);
    std::optional<estimator::Prior> prior;
    if (const auto normal = object.find("normal")) {
        const Pair pair = read_pair(*normal, "mean", "sd", false, true);
        prior = estimator::NormalPrior{pair.first, pair.second};
    }
    if (const auto lognormal = object.find("lognormal")) {
        const Pair pair = read_pair(*lognormal, "median", "log_sd", true, true);
        prior = estimator::LogNormalPrior{pair.first, pair.second};
    }
    if (const auto uniform = object.find("uniform")) {
        const Pair pair = read_pair(*uniform, "lower", "upper", false, false);
        if (!(pair.first < pair.second)) {
            uniform->report(fmt::format("lower {} must be below upper {}", pair.first, pair.second));
        }
        prior = estimator::UniformPrior{pair.first, pair.second};
    }
    object.finish();
    if (value.value().members.empty()) value.report(fmt::format("must be {}", prior_forms));
    return prior;
}

std::optional<estimator::ErrorScale> read_error_scale(const ValueReader& value) {
    estimator::ErrorScale scale;
    scale.value = 0.0;  // estimated without a start: from the residuals
    if (value.is(JsonValue::Kind::number)) {
        const auto sd = value.positive();
        if (!sd) return std::nullopt;
        scale.estimate = false;
        scale.value = *sd;
        return scale;
    }
    if (value.is(JsonValue::Kind::string)) {
        if (!value.choice({"estimate"})) return std::nullopt;
        return scale;
    }
    if (!value.is(JsonValue::Kind::object)) {
        value.report_kind("a number > 0, \"estimate\" or { \"estimate\": { \"start\": ..., \"prior\": ... } }");
        return std::nullopt;
    }
    ObjectReader object(value);
    object.reserve({"column", "factor"});
    if (const auto estimate = object.find("estimate")) {
        ObjectReader inner(*estimate);
        if (const auto start = inner.find("start")) scale.value = start->positive().value_or(1.0);
        if (const auto prior = inner.find("prior")) scale.prior = read_prior(*prior).value_or(estimator::Prior{});
        inner.finish();
    } else if (value.value().members.empty()) {
        value.report("needs \"estimate\": { ... }");
    }
    object.finish();
    return scale;
}

}  // namespace orbid::apps
