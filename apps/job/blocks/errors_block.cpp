#include <algorithm>
#include <array>

#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/estimated_number.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using estimator::ErrorParameter;
using estimator::ErrorScale;

/// Estimated, from the residuals.
ErrorJob unknown_error(Eigen::Index coordinate) {
    ErrorJob error;
    error.coordinate = coordinate;
    error.scale.value = 0.0;
    return error;
}

/// The parameter that a distribution has beside its scale. Where that one is not chosen the key is refused.
template <class Distribution>
Field<ErrorJob> shape_field(KeySchema described, const std::string& distribution,
                            ErrorParameter Distribution::*member) {
    const ErrorParameter usual = Distribution{}.*member;
    described.with("distribution", {distribution});
    if (usual.estimate) {
        described.by_default("estimate");
    } else {
        described.by_default(usual.value);
    }
    described.value = number_or_estimate(described.value);
    return {std::move(described),
            [member](const ValueReader& value, const Job&, ErrorJob& error) {
                if (auto* chosen = std::get_if<Distribution>(&error.distribution))
                    read_number_or_estimate(value, chosen->*member);
            },
            [member](const ErrorJob& error, const Writing&) {
                return number_or_estimate_document(std::get<Distribution>(error.distribution).*member);
            }};
}

/// "sd" as an object: { "estimate": ... } or { "column", "factor" }.
const FieldTable<ErrorJob>& scale_fields() {
    const auto has_column = [](const ErrorJob& error) { return !error.sd_column.empty(); };
    KeySchema estimated = number_or_estimate(above(0.0)).object->keys.front();
    estimated.required = false;  // or a column
    static const FieldTable<ErrorJob> table{
        {estimated, [](const ValueReader& value, const Job&, ErrorJob& error) { read_estimated(value, error.scale); },
         [=](const ErrorJob& error, const Writing&) {
             return has_column(error) ? left_out() : estimated_scale_document(error.scale);
         }},
        text_field(key("column", header(), "Header of a column of sds in the table of the data."), &ErrorJob::sd_column)
            .with_rule([](const ValueReader&, const Job&, ErrorJob& error) {
                error.scale.estimate = false;
                error.scale.value = 1.0;
            }),
        {key("factor", number_or_estimate(above(0.0)), "On the sds of that column.").by_default(1).with("column"),
         [](const ValueReader& value, const Job&, ErrorJob& error) {
             error.scale.value = 0.0;
             read_number_or_estimate(value, error.scale);
         },
         [](const ErrorJob& error, const Writing&) { return number_or_estimate_document(error.scale); }}};
    return table;
}

Field<ErrorJob> sd_field() {
    const ValueSchema forms =
        above(0.0) | choice({"estimate"}) | object(keys_of(scale_fields()), {"estimate", "column"});
    return {key("sd", named("sd", forms),
                "Standard deviation or scale; with weights \"covariance\" a factor on the covariance of the analysis.")
                .by_default("estimate"),
            [](const ValueReader& value, const Job& job, ErrorJob& error) {
                if (value.is(JsonValue::Kind::object)) return read_object(value, scale_fields(), error, job);
                read_number_or_estimate(value, error.scale);
            },
            [](const ErrorJob& error, const Writing& at) {
                const bool number = error.sd_column.empty() && !error.scale.estimate;
                return number ? Json(error.scale.value) : fields_document(error, scale_fields(), at);
            }};
}

void read_distribution(const ValueReader& value, const Job&, ErrorJob& error) {
    using namespace estimator;
    static const std::array<ErrorDistribution, 6> usual{NormalErrors{},    StudentErrors{},  LaplaceErrors{},
                                                        LogNormalErrors{}, RelativeErrors{}, AutoregressiveErrors{}};
    error.distribution = usual[value.choice(distribution_names).value_or(0)];
}

void check_floor(const ValueReader& floor, const Job&, ErrorJob& error) {
    if (!error.scale.estimate) floor.report("belongs to a sd that is estimated; this one is given");
    if (error.scale.estimate && error.scale.value > 0.0 && error.scale.value < error.floor)
        floor.report(fmt::format("{} lies above the start {} of the sd", error.floor, error.scale.value));
}

/// Of one coordinate.
const FieldTable<ErrorJob>& error_fields() {
    using namespace estimator;
    static const FieldTable<ErrorJob> table{
        {key("distribution", choice(distribution_names), "Of a reading about its prediction.").by_default("normal"),
         read_distribution,
         [](const ErrorJob& error, const Writing&) -> Json {
             return name_of(error.distribution.index(), distribution_names);
         }},
        shape_field(key("dof", at_least(1.0), "Degrees of freedom of Student's t."), "student_t", &StudentErrors::dof),
        shape_field(key("relative", above(0.0), "Share of the prediction that is added to the sd."), "relative",
                    &RelativeErrors::relative),
        shape_field(key("correlation", between(-1.0, 1.0), "Of one reading with the next."), "ar1",
                    &AutoregressiveErrors::correlation),
        sd_field(),
        field(key("floor", at_least(0.0), "Least value that an estimated sd may take."), &ErrorJob::floor)
            .with_rule(check_floor)
            .written_if([](const ErrorJob& error) { return error.floor > 0.0; })};
    return table;
}

/// Errors of ln|multiplier|, or of T: a sd, or with weights "covariance" a factor on the analysis' covariance.
const FieldTable<ErrorScale>& multiplier_error_fields() {
    static const FieldTable<ErrorScale> table{
        // Other distributions would need other curvatures than those that the analysis' covariance gives.
        {key("distribution", choice({"normal"}), "Of ln|multiplier| or T.").by_default("normal"),
         [](const ValueReader& value, const Job&, ErrorScale&) { (void)value.choice({"normal"}); },
         [](const ErrorScale&, const Writing&) { return left_out(); }},
        {key("sd", number_or_estimate(above(0.0)), "As of a coordinate.").by_default("estimate"),
         [](const ValueReader& value, const Job&, ErrorScale& scale) { read_number_or_estimate(value, scale); },
         [](const ErrorScale& scale, const Writing&) { return number_or_estimate_document(scale); }}};
    return table;
}

/// Errors of what belongs to a cycle as a whole. @param scale  nullptr: it is no data
void read_cycle_error(const ValueReader& member, const ErrorUse& use, ErrorScale* scale, const char* key,
                      const Job& job) {
    if (use.records == ErrorUse::Records::series) {
        member.report(fmt::format("belongs to a residual of type cycles: a series has no {}", key));
    } else if (scale == nullptr) {
        member.report(fmt::format("needs \"{}\": true: they are no data yet", key));
    } else {
        read_object(member, multiplier_error_fields(), *scale, job);
    }
}

/// What is said in one entry of "errors" beyond its numbers, for checks that look at several entries.
struct ErrorEntry {
    ErrorJob* error;
    ValueReader at;
};

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

ErrorJob* find_error(std::vector<ErrorJob>& errors, Eigen::Index coordinate) {
    const auto found =
        std::find_if(errors.begin(), errors.end(), [&](const ErrorJob& one) { return one.coordinate == coordinate; });
    return found != errors.end() ? &*found : nullptr;
}

/// The coordinates of a covariance: observed, and with errors that allow one.
void check_joint_coordinates(const ValueReader& list, const Job& job, const std::vector<ErrorEntry>& entries,
                             std::vector<ErrorJob>& errors) {
    for (const auto& [name, item] : read_names(list)) {
        const Eigen::Index index = job.model.system ? job.model.system->coordinate_index(name) : -1;
        if (index < 0) continue;
        const ErrorJob* error = find_error(errors, index);
        if (error == nullptr) {
            item.report(fmt::format("\"{}\" is not observed: it has no errors", name));
            continue;
        }
        const bool plain = is_normal(*error) && error->sd_column.empty() && error->scale.estimate &&
                           std::holds_alternative<estimator::FlatPrior>(error->scale.prior);
        if (plain) continue;
        const auto entry =
            std::find_if(entries.begin(), entries.end(), [&](const ErrorEntry& one) { return one.error == error; });
        (entry != entries.end() ? entry->at : list)
            .report(fmt::format("{} has a full covariance with others: its errors must be normal, their sd "
                                "estimated (a \"start\" is allowed), its prior that of the covariance",
                                name));
    }
}

/// ["a", "b"], or { "of": ["a", "b"], "prior": { "inverse_wishart": ... } }.
void read_covariance(const ValueReader& value, const ErrorUse& use, const Job& job,
                     const std::vector<ErrorEntry>& entries, std::vector<ErrorJob>& errors,
                     std::vector<CovarianceJob>& covariances) {
    CovarianceJob covariance;
    read_short_or_object(value, "of", covariance_fields(), covariance, job);
    const auto of = value.is(JsonValue::Kind::object) ? ObjectReader(value).find("of") : value;
    if (of) check_joint_coordinates(*of, job, entries, errors);
    if (use.records == ErrorUse::Records::cycles_with_covariance)
        value.report("with \"weights\": \"covariance\" the analysis' covariance stands in its place: use \"equal\"");
    for (const std::size_t index : use.data) {
        const DataJob& data = job.data[index];
        for (const Eigen::Index coordinate : covariance.coordinates) {
            if (data.observes(coordinate) || find_error(errors, coordinate) == nullptr) continue;
            value.report(fmt::format("\"{}\" does not observe {}", data.name, job.model.coordinate(coordinate).name));
        }
    }
    covariances.push_back(std::move(covariance));
}

}  // namespace

void ErrorUse::add_coordinates(const std::vector<Eigen::Index>& more) {
    coordinates.insert(coordinates.end(), more.begin(), more.end());
    std::sort(coordinates.begin(), coordinates.end());
    coordinates.erase(std::unique(coordinates.begin(), coordinates.end()), coordinates.end());
}

KeySchema errors_key() {
    const ValueSchema error = named("error", object(keys_of(error_fields())));
    return key("errors",
               entries(error, "an observed coordinate",
                       {covariance_key(),
                        key("ln_multiplier", object(keys_of(multiplier_error_fields())),
                            "Errors of ln|multiplier| of cycles."),
                        key("time", object(keys_of(multiplier_error_fields())),
                            "Errors of the time in which cycles of autonomous models close.")}),
               "How readings err, by coordinate; one left out is normal with an estimated sd.");
}

ErrorJob read_error(const ValueReader& value, const Job& job) {
    ErrorJob error = unknown_error(0);
    read_object(value, error_fields(), error, job);
    return error;
}

Json error_document(const ErrorJob& error, const Writing& at) {
    return fields_document(error, error_fields(), at);
}

void read_errors(ObjectReader& residual, const ErrorUse& use, const Job& job, std::vector<ErrorJob>& errors,
                 std::vector<CovarianceJob>& covariances) {
    errors.clear();
    for (const Eigen::Index coordinate : use.coordinates)
        errors.push_back(unknown_error(coordinate));
    const auto block = residual.find("errors");
    std::vector<ErrorEntry> entries;
    std::optional<ValueReader> within;
    for (const auto& [name, member] : block ? block->members() : std::vector<std::pair<std::string, ValueReader>>{}) {
        if (name == "covariance") {
            within = member;
            continue;
        }
        if (name == "ln_multiplier") {
            read_cycle_error(member, use, use.multipliers, "multipliers", job);
            continue;
        }
        if (name == "time" &&
            (use.times != nullptr || job.model.system == nullptr || job.model.system->coordinate_index(name) < 0)) {
            read_cycle_error(member, use, use.times, "times", job);
            continue;
        }
        const std::size_t problems_before = member.problem_count();
        ErrorJob read = read_error(member, job);
        const auto index = coordinate_named(name, member, job);
        if (!index) continue;
        read.coordinate = *index;
        ErrorJob* error = find_error(errors, *index);
        if (error == nullptr) {
            const bool of_plane = job.section_plane && job.section_plane->coordinate == *index;
            member.report(fmt::format("\"{}\" {}: it has no errors", name,
                                      of_plane ? "has the value of the section at every point" : "is not observed"));
            continue;
        }
        *error = std::move(read);
        entries.push_back({error, member});
        if (member.sound() && member.problem_count() == problems_before) check_use(entries.back(), use, job);
    }
    const auto beside = residual.find("covariance");
    if (within && beside) beside->report("stands in \"errors\" already");
    if (within || beside) read_covariance(within ? *within : *beside, use, job, entries, errors, covariances);
}

Json errors_document(const std::vector<ErrorJob>& errors, const ErrorScale* multipliers, const ErrorScale* times,
                     const Writing& at) {
    Json object = Json::object();
    for (const ErrorJob& error : errors)
        object[coordinate_name(at.job, error.coordinate)] = fields_document(error, error_fields(), at);
    if (multipliers != nullptr) object["ln_multiplier"] = fields_document(*multipliers, multiplier_error_fields(), at);
    if (times != nullptr) object["time"] = fields_document(*times, multiplier_error_fields(), at);
    return object;
}

}  // namespace orbid::apps::describe
