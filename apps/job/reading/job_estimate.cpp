#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// "tied" of a parameter; resolve_tie() follows when all parameters are read.
void read_tie(const ValueReader& tie, FreeParameterJob& free) {
    estimator::FreeParameter& value = free.value;
    if (tie.is(JsonValue::Kind::string)) return tie.read(value.tied_to);
    ObjectReader inner(tie);
    inner.read("to", value.tied_to);
    inner.read("factor", value.tie_factor);
    inner.finish();
}

/// Checks a tie against all parameters; takes start and scale from the parameter it follows.
void resolve_tie(const ValueReader& at, const Job& job, const EstimateJob& estimate, FreeParameterJob& free) {
    estimator::FreeParameter& value = free.value;
    const auto& all = estimate.parameters;
    const auto leader = std::find_if(all.begin(), all.end(),
                                     [&](const FreeParameterJob& other) { return other.value.name == value.tied_to; });
    if (value.tied_to == value.name) {
        at.report(fmt::format("{} is tied to itself", value.name));
        return;
    }
    if (leader == all.end()) {
        std::vector<std::string> names;
        for (const FreeParameterJob& other : all)
            if (other.value.name != value.name) names.push_back(other.value.name);
        at.report(fmt::format("\"{}\" is no estimated parameter{}", value.tied_to, suggestion(value.tied_to, names)));
        return;
    }
    if (!leader->value.tied_to.empty()) {
        at.report(
            fmt::format("{} is tied to {} itself: tie both to that one", leader->value.name, leader->value.tied_to));
        return;
    }
    for (const DataJob& data : job.data) {
        if (!data.has_own(leader->parameter) || data.has_own(free.parameter)) continue;
        at.report(fmt::format("{} is free in \"{}\": list {} in \"free\" there too", leader->value.name, data.name,
                              value.name));
    }
    value.start = value.tie_factor * leader->value.start;
    const models::Parameter& entry = job.model.parameter(free.parameter);
    if (!models::contains(entry.domain, value.start))
        at.report(fmt::format("start {} of {} ({}), {} times that of {}: must be {}", value.start, value.name,
                              entry.description, value.tie_factor, leader->value.name, models::rule(entry.domain)));
    // Zero is no value of a positive parameter, and no bound that the followed one reaches on a log scale.
    value.scale = leader->value.scale;
    value.lower = entry.domain == models::Domain::real ? -infinity : 0.0;
}

/// Scales whose ends are never reached: the end of a domain may be one although no value.
bool is_logarithmic(estimator::Scale scale) {
    return scale == estimator::Scale::log || scale == estimator::Scale::log10;
}

/// [lower, upper], null = none.
void read_bounds(const ValueReader& value, const models::Parameter& entry, estimator::FreeParameter& free) {
    const auto items = value.items();
    if (items.size() != 2) return;
    const auto bound = [](const ValueReader& item, double none) {
        return item.is(JsonValue::Kind::null) ? none : item.number().value_or(none);
    };
    const bool no_lower = items[0].is(JsonValue::Kind::null);
    const double lower = bound(items[0], free.lower);
    const double upper = bound(items[1], infinity);
    if (!(lower < upper)) {
        value.report(fmt::format("lower bound {} must be below the upper bound {}", lower, upper));
        return;
    }
    const bool log_scale = is_logarithmic(free.scale);
    // On a log or logit scale the bound 0 is never reached.
    const bool open_zero = log_scale || (free.scale == estimator::Scale::logit && lower == 0.0);
    const bool allowed = no_lower || (open_zero ? lower >= 0.0 : models::contains(entry.domain, lower));
    if (!allowed) {
        items[0].report(fmt::format("lower bound {} lies outside the domain of {}: must be {}", lower, entry.name,
                                    log_scale ? ">= 0 on a log scale" : models::rule(entry.domain)));
        return;
    }
    free.lower = lower;
    free.upper = upper;
}

void check_start(const ValueReader& at, const models::Parameter& entry, const estimator::FreeParameter& free) {
    if (!models::contains(entry.domain, free.start)) {
        at.report(fmt::format("start {} of {} ({}): must be {}", free.start, entry.name, entry.description,
                              models::rule(entry.domain)));
    } else if (is_logarithmic(free.scale) && !(free.start > 0.0)) {
        at.report(fmt::format("start {} of {} has no logarithm: use \"scale\": \"linear\", or a start > 0", free.start,
                              entry.name));
    } else if (free.scale == estimator::Scale::logit && !(free.lower < free.start && free.start < free.upper)) {
        at.report(fmt::format("start {} of {} must lie inside its bounds ({}, {}) on a logit scale", free.start,
                              entry.name, free.lower, free.upper));
    } else if (!(free.lower <= free.start && free.start <= free.upper)) {
        at.report(fmt::format("start {} of {} lies outside its bounds [{}, {}]", free.start, entry.name, free.lower,
                              free.upper));
    } else if (!std::isfinite(estimator::negative_log_density(free.prior, free.start))) {
        at.report(fmt::format("start {} of {} has no density under its prior", free.start, entry.name));
    }
}

FreeParameterJob read_free(const ValueReader& value, Eigen::Index index, const Job& job) {
    const models::Parameter& entry = job.model.parameter(index);
    FreeParameterJob result{index, identification::free_parameter(entry, job.model.values[index])};
    estimator::FreeParameter& free = result.value;
    ObjectReader object(value);
    if (const auto tie = object.find("tied")) {
        read_tie(*tie, result);
        object.finish();
        return result;
    }
    const std::size_t problems_before = value.problem_count();
    const auto scale = object.choose("scale", scale_names, free.scale);
    const auto start = object.read("start", free.start);
    identification::set_default_bounds(entry, free);
    if (const auto bounds = object.find("bounds")) read_bounds(*bounds, entry, free);
    if (scale && free.scale == estimator::Scale::logit && !(std::isfinite(free.lower) && std::isfinite(free.upper)))
        scale->report(fmt::format("a logit scale needs finite \"bounds\"; they are [{}, {}]", free.lower, free.upper));
    if (const auto prior = object.find("prior")) free.prior = read_prior(*prior).value_or(estimator::Prior{});
    object.finish();
    // What is wrong already would only be reported a second time in other words.
    if (value.sound() && value.problem_count() == problems_before) check_start(start.value_or(value), entry, free);
    return result;
}

void read_derived(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    const std::vector<std::string> names = parameter_names(job);
    for (const auto& [name, member] : value.members()) {
        const auto text = member.text();
        if (!is_name(name, member) || !text) continue;
        if (std::find(names.begin(), names.end(), name) != names.end())
            member.report(fmt::format("\"{}\" is a parameter of the model already", name));
        if (!job.model.system) continue;
        try {
            estimate.derived.push_back({name, models::Expression::parse(*text, names)});
        } catch (const models::ExpressionError& error) {
            member.report_character(error.position, error.what());
            // Named all the same, so that its reference value is not called unknown.
            estimate.derived.push_back({name, {}});
        }
    }
}

void check_experiments(const ValueReader& at, const Job& job, const EstimateJob& estimate) {
    const auto names = parameter_names(job);
    const auto is_free = [&](Eigen::Index index) {
        return std::any_of(estimate.parameters.begin(), estimate.parameters.end(),
                           [&](const FreeParameterJob& free) { return free.parameter == index; });
    };
    for (const DataJob& data : job.data) {
        for (const Eigen::Index index : data.free) {
            if (is_free(index)) continue;
            at.report(fmt::format("{} is free in \"{}\", but has no entry in \"parameters\" (its start and bounds)",
                                  names[static_cast<std::size_t>(index)], data.name));
        }
        for (const ParameterValue& value : data.parameters) {
            const bool own = std::find(data.free.begin(), data.free.end(), value.parameter) != data.free.end();
            if (own || data.simulation || !is_free(value.parameter)) continue;
            at.report(fmt::format("{} is estimated, and given for \"{}\": list it in \"free\" there, or leave one out",
                                  names[static_cast<std::size_t>(value.parameter)], data.name));
        }
    }
}

}  // namespace

void read_estimate(ObjectReader& root, Job& job) {
    const auto value = root.find("estimate");
    if (!value) {
        for (const DataJob& data : job.data)
            if (!data.free.empty()) root.self().report(fmt::format("\"free\" in \"{}\" needs \"estimate\"", data.name));
        return;
    }
    EstimateJob estimate;
    ObjectReader object(*value);
    if (const auto parameters = object.find("parameters")) {
        for (const auto& [name, member] : parameters->members()) {
            const auto index = parameter_named(name, member, job);
            if (index) estimate.parameters.push_back(read_free(member, *index, job));
        }
        for (const auto& [name, member] : parameters->members()) {
            for (FreeParameterJob& free : estimate.parameters) {
                if (free.value.name != name || free.value.tied_to.empty()) continue;
                ObjectReader object_of(member);
                resolve_tie(object_of.find("tied").value_or(member), job, estimate, free);
            }
        }
        if (job.model.system) check_experiments(*parameters, job, estimate);
    }
    if (const auto priors = object.find("joint_priors")) read_joint_priors(*priors, job, estimate);
    if (const auto derived = object.find("derived")) read_derived(*derived, job, estimate);
    const auto strategy = object.find("strategy");
    estimate.automatic = strategy && strategy->is(JsonValue::Kind::string) && strategy->value().text == "auto";
    if (const auto residuals = object.find("residuals")) {
        read_residuals(*residuals, job, estimate);
    } else if (estimate.automatic) {
        add_usual_residuals(*strategy, object.description_of("residuals"), job, estimate);
    } else {
        (void)object.require("residuals",
                             "[ { \"type\": \"cycles\" } ], for example; with \"strategy\": \"auto\" not needed");
    }
    object.choose("variance", variance_names, estimate.variance);
    if (object.find("residuals") || estimate.automatic) {
        read_strategy(object, job, estimate);
    } else {
        // What is missing is reported; that the stages lack it would only say so again.
        (void)object.find("scan");
    }
    read_posterior(object, job, estimate);
    read_criticism(object, job, estimate);
    object.finish();
    job.estimate = std::move(estimate);
}

}  // namespace orbid::apps
