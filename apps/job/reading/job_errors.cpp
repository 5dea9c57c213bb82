#include <algorithm>
#include <array>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::apps {

namespace {

/// What is said in one entry of "errors" beyond its numbers, for checks that look at several entries.
struct ErrorEntry {
    ErrorJob* error;
    ValueReader at;
};

/// The inner part of { "estimate": { "start", "prior" } }.
void read_estimated(const ValueReader& value, double& start, estimator::Prior& prior) {
    ObjectReader object(value);
    object.read("start", start);
    if (const auto entry = object.find("prior")) prior = read_prior(*entry).value_or(estimator::Prior{});
    object.finish();
}

/// number | "estimate" | { "estimate": { "start", "prior" } }. `unset` is the start where none is given.
void read_number_or_estimate(const ValueReader& value, double unset, bool& estimate, double& target,
                             estimator::Prior& prior) {
    if (value.is(JsonValue::Kind::number)) {
        estimate = false;
        target = value.number().value_or(target);
        return;
    }
    estimate = true;
    target = unset;
    if (value.is(JsonValue::Kind::string)) {
        (void)value.choice({"estimate"});
    } else if (value.is(JsonValue::Kind::object)) {
        ObjectReader object(value);
        if (const auto inner = object.find("estimate")) read_estimated(*inner, target, prior);
        object.finish();
    }
}

void read_scale(const ValueReader& value, ErrorJob& error) {
    estimator::ErrorScale& scale = error.scale;
    const bool has_column = value.is(JsonValue::Kind::object) &&
                            std::any_of(value.value().members.begin(), value.value().members.end(),
                                        [](const JsonMember& member) { return member.key == "column"; });
    if (!has_column) {
        read_number_or_estimate(value, 0.0, scale.estimate, scale.value, scale.prior);
        return;
    }
    ObjectReader object(value);
    object.read("column", error.sd_column);
    scale.estimate = false;
    scale.value = 1.0;
    if (const auto factor = object.find("factor"))
        read_number_or_estimate(*factor, 0.0, scale.estimate, scale.value, scale.prior);
    object.finish();
}

estimator::ErrorDistribution read_distribution(ObjectReader& object) {
    using namespace estimator;
    static const std::array<ErrorDistribution, 6> usual{NormalErrors{},    StudentErrors{},  LaplaceErrors{},
                                                        LogNormalErrors{}, RelativeErrors{}, AutoregressiveErrors{}};
    std::size_t choice = 0;
    object.choose("distribution", distribution_names, choice);
    ErrorDistribution distribution = usual[choice];
    const auto [key, shape] = error_shape(distribution);
    const auto value = shape != nullptr ? object.find(key) : std::nullopt;
    if (value) read_number_or_estimate(*value, shape->value, shape->estimate, shape->value, shape->prior);
    return distribution;
}

void read_error(const ValueReader& value, ErrorJob& error) {
    ObjectReader object(value);
    error.distribution = read_distribution(object);
    if (const auto sd = object.find("sd")) read_scale(*sd, error);
    if (const auto floor = object.read("floor", error.floor)) {
        if (!error.scale.estimate) floor->report("belongs to a sd that is estimated; this one is given");
        if (error.scale.estimate && error.scale.value > 0.0 && error.scale.value < error.floor)
            floor->report(fmt::format("{} lies above the start {} of the sd", error.floor, error.scale.value));
    }
    object.finish();
}

bool is_normal(const ErrorJob& error) {
    return std::holds_alternative<estimator::NormalErrors>(error.distribution);
}

bool has_size(const ErrorJob& error) {
    return std::holds_alternative<estimator::LogNormalErrors>(error.distribution) ||
           std::holds_alternative<estimator::RelativeErrors>(error.distribution);
}

/// What a residual's records allow.
void check_use(const ErrorEntry& entry, const ErrorUse& use, const Job& job) {
    const ErrorJob& error = *entry.error;
    const models::Coordinate& coordinate = job.model.coordinate(error.coordinate);
    if (has_size(error) && reads_angle(job, use.data, error.coordinate))
        entry.at.report(
            fmt::format("{} is an angle: it has no size that such errors could be relative to", coordinate.name));
    if (has_size(error) && !error.sd_column.empty()) {
        entry.at.report("a column of sds goes with \"normal\", \"student_t\", \"laplace\" or \"ar1\"");
        return;
    }
    if (use.records == ErrorUse::Records::series) {
        for (const std::size_t index : use.data) {
            const DataJob& data = job.data[index];
            if (error.sd_column.empty() || !data.observes(error.coordinate) || (data.file && data.file->table))
                continue;
            entry.at.report(
                fmt::format("\"{}\" is no table in text: it has no column \"{}\"", data.name, error.sd_column));
        }
        return;
    }
    if (!error.sd_column.empty())
        entry.at.report("cycles have no column of sds: their covariance comes from the analysis");
    if (std::holds_alternative<estimator::AutoregressiveErrors>(error.distribution)) {
        entry.at.report("the points of a cycle are no course in time: \"ar1\" belongs to a series");
    } else if (has_size(error) && !coordinate.angle) {
        entry.at.report("positions of cycles have no such errors: \"lognormal\" and \"relative\" belong to a series");
    } else if (!is_normal(error) && use.records == ErrorUse::Records::cycles_with_covariance) {
        entry.at.report("with \"weights\": \"covariance\" errors must be normal: the covariance links the coordinates");
    }
}

void read_wishart(const ValueReader& value, CovarianceJob& covariance) {
    const auto size = static_cast<Eigen::Index>(covariance.coordinates.size());
    ObjectReader prior(value);
    const auto inner = prior.find("inverse_wishart");
    prior.finish();
    if (!inner) return;
    ObjectReader object(*inner);
    if (const auto dof = object.find("dof")) {
        covariance.dof =
            dof->number([&](double x) { return x > static_cast<double>(size - 1); }, fmt::format("> {}", size - 1))
                .value_or(0.0);
    }
    if (const auto matrix = object.find("matrix")) {
        covariance.psi = read_matrix(*matrix, size).value_or(Eigen::MatrixXd::Identity(size, size));
        const Eigen::MatrixXd& psi = covariance.psi;
        if (psi != psi.transpose() || !models::CholeskyFactor(psi).positive_definite())
            matrix->report("must be symmetric and positive definite");
    }
    object.finish();
}

/// ["a", "b"], or { "of": ["a", "b"], "prior": { "inverse_wishart": ... } }.
void read_covariance(const ValueReader& value, const ErrorUse& use, const Job& job,
                     const std::vector<ErrorEntry>& entries, std::vector<ErrorJob>& errors,
                     std::vector<CovarianceJob>& covariances) {
    CovarianceJob covariance;
    const auto read_list = [&](const ValueReader& list) {
        for (const auto& [name, item] : read_names(list)) {
            const auto index = coordinate_named(name, item, job);
            if (!index) continue;
            const auto error = std::find_if(errors.begin(), errors.end(),
                                            [&](const ErrorJob& one) { return one.coordinate == *index; });
            if (error == errors.end()) {
                item.report(fmt::format("\"{}\" is not observed: it has no errors", name));
                continue;
            }
            covariance.coordinates.push_back(*index);
            const bool plain = is_normal(*error) && error->sd_column.empty() && error->scale.estimate &&
                               std::holds_alternative<estimator::FlatPrior>(error->scale.prior);
            if (plain) continue;
            const auto entry = std::find_if(entries.begin(), entries.end(),
                                            [&](const ErrorEntry& one) { return one.error == &*error; });
            (entry != entries.end() ? entry->at : list)
                .report(fmt::format("{} has a full covariance with others: its errors must be normal, their sd "
                                    "estimated (a \"start\" is allowed), its prior that of the covariance",
                                    name));
        }
    };
    if (value.is(JsonValue::Kind::array)) {
        read_list(value);
    } else {
        ObjectReader object(value);
        if (const auto of = object.find("of")) read_list(*of);
        if (const auto prior = object.find("prior")) read_wishart(*prior, covariance);
        object.finish();
    }
    if (use.records == ErrorUse::Records::cycles_with_covariance)
        value.report("with \"weights\": \"covariance\" the analysis' covariance stands in its place: use \"equal\"");
    for (const std::size_t index : use.data) {
        const DataJob& data = job.data[index];
        for (const Eigen::Index coordinate : covariance.coordinates) {
            if (data.observes(coordinate)) continue;
            value.report(fmt::format("\"{}\" does not observe {}", data.name, job.model.coordinate(coordinate).name));
        }
    }
    covariances.push_back(std::move(covariance));
}

}  // namespace

estimator::ErrorScale read_multiplier_error(const ValueReader& value) {
    estimator::ErrorScale scale{true, 0.0, estimator::FlatPrior{}};
    ObjectReader object(value);
    // Other distributions would need other curvatures than those that the analysis' covariance gives.
    if (const auto distribution = object.find("distribution")) (void)distribution->choice({"normal"});
    if (const auto sd = object.find("sd")) read_number_or_estimate(*sd, 0.0, scale.estimate, scale.value, scale.prior);
    object.finish();
    return scale;
}

void read_errors(ObjectReader& residual, const ErrorUse& use, const Job& job, std::vector<ErrorJob>& errors,
                 std::vector<CovarianceJob>& covariances) {
    errors.clear();
    for (const Eigen::Index coordinate : use.coordinates) {
        ErrorJob error;
        error.coordinate = coordinate;
        error.scale = {true, 0.0, estimator::FlatPrior{}};
        errors.push_back(std::move(error));
    }
    const auto block = residual.find("errors");
    std::vector<ErrorEntry> entries;
    std::optional<ValueReader> within;
    for (const auto& [name, member] : block ? block->members() : std::vector<std::pair<std::string, ValueReader>>{}) {
        if (name == "covariance") {
            within = member;
            continue;
        }
        if (name == "ln_multiplier" && use.records != ErrorUse::Records::series) {
            if (use.multipliers == nullptr) {
                member.report("needs \"multipliers\": true: they are no data yet");
            } else {
                *use.multipliers = read_multiplier_error(member);
            }
            continue;
        }
        ErrorJob read;
        read.scale = {true, 0.0, estimator::FlatPrior{}};
        const std::size_t problems_before = member.problem_count();
        read_error(member, read);
        const auto index = coordinate_named(name, member, job);
        if (!index) continue;
        read.coordinate = *index;
        const auto error =
            std::find_if(errors.begin(), errors.end(), [&](const ErrorJob& one) { return one.coordinate == *index; });
        if (error == errors.end()) {
            member.report(fmt::format("\"{}\" is not observed: it has no errors", name));
            continue;
        }
        *error = std::move(read);
        entries.push_back({&*error, member});
        if (member.sound() && member.problem_count() == problems_before) check_use(entries.back(), use, job);
    }
    const auto beside = residual.find("covariance");
    if (within && beside) beside->report("stands in \"errors\" already");
    if (within || beside) read_covariance(within ? *within : *beside, use, job, entries, errors, covariances);
}

}  // namespace orbid::apps
