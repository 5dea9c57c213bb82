#include <algorithm>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/data_job.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Branch = BranchResidualJob;
using periodic::OrbitMeasure;

constexpr OrbitMeasure measures[] = {OrbitMeasure::maximum,    OrbitMeasure::minimum, OrbitMeasure::mean,
                                     OrbitMeasure::half_range, OrbitMeasure::rms,     OrbitMeasure::frequency};

/// All that can be measured of the model's orbits, by name.
std::vector<std::string> measurable(const Job& job, const Branch& branch) {
    std::vector<std::string> names;
    if (!job.model.system) return names;
    for (std::size_t i = 0; i < coordinate_names(job).size() + branch.readings.size(); ++i)
        for (const OrbitMeasure measure : measures)
            if (measure != OrbitMeasure::frequency)
                names.push_back(branch.measure_name(*job.model.system, measure, static_cast<Eigen::Index>(i)));
    names.push_back(periodic::name_of(OrbitMeasure::frequency));
    return names;
}

const FieldTable<periodic::OrbitReading>& reading_fields() {
    using Reading = periodic::OrbitReading;
    static const FieldTable<Reading> table{
        {key("formula", text(), "Of coordinates and parameters.").required_always(),
         [](const ValueReader& value, const Job& job, Reading& reading) {
             const auto formula = value.text();
             if (!formula || !job.model.system) return;
             try {
                 const auto names =
                     models::reading_names(job.model.system->coordinates(), job.model.system->parameters());
                 reading.formula = models::Expression::parse(*formula, names);
             } catch (const models::ExpressionError& error) {
                 value.report_character(error.position, error.what());
             }
         },
         [](const Reading& reading, const Writing&) -> Json { return reading.formula.text(); }},
        field(key("unit", text(), "Of its values."), &Reading::unit)};
    return table;
}

void read_branch_readings(const ValueReader& value, const Job& job, Branch& branch) {
    for (const auto& [name, member] : value.members()) {
        if (!is_name(name, member)) continue;
        if (is_in(name, coordinate_names(job)) || is_in(name, parameter_names(job)) ||
            name == periodic::name_of(OrbitMeasure::frequency)) {
            member.report(fmt::format("\"{}\" is the name of something else already: give the reading its own", name));
            continue;
        }
        periodic::OrbitReading& reading = branch.readings.emplace_back();
        reading.name = name;
        read_short_or_object(member, "formula", reading_fields(), reading, job);
    }
}

Json branch_readings_document(const Branch& branch, const Writing& at) {
    Json readings = Json::object();
    for (const periodic::OrbitReading& reading : branch.readings)
        readings[reading.name] = fields_document(reading, reading_fields(), at);
    return readings;
}

/// The measure of this name, in its unit; nothing after an unknown name has been reported.
std::optional<Branch::Measure> measure_named(const std::string& name, const ValueReader& at, const Job& job,
                                             const Branch& branch) {
    const auto names = measurable(job, branch);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
        if (job.model.system)
            at.report(fmt::format("\"{}\" is no measure of an orbit{}", name, suggestion(name, names)));
        return std::nullopt;
    }
    Branch::Measure result;
    const auto index = static_cast<std::size_t>(found - names.begin());
    result.measure = measures[index % 5];
    result.column.coordinate = static_cast<Eigen::Index>(index / 5);
    result.column.unit = "Hz";
    if (found + 1 == names.end()) {
        result.measure = OrbitMeasure::frequency;
        result.column.coordinate = 0;
    } else {
        result.column.unit = branch.quantity(*job.model.system, result.column.coordinate).second;
    }
    result.error.scale.value = 0.0;
    return result;
}

void read_branch_parameter(const ValueReader& value, const Job& job, Branch& branch) {
    const auto name = value.text();
    const auto index = name ? parameter_named(*name, value, job) : std::nullopt;
    branch.parameter = index.value_or(-1);
    if (!index) return;
    branch.at.column = *name;
    branch.at.unit = job.model.parameter(*index).unit;
}

void read_branch_columns(const ValueReader& value, const Job& job, Branch& branch) {
    const std::string parameter = branch.parameter >= 0 ? parameter_name(job, branch.parameter) : std::string();
    for (const auto& [name, member] : value.members()) {
        if (name == parameter) {
            branch.at = read_column(member, 0, branch.at.unit);
            continue;
        }
        auto measure = measure_named(name, member, job, branch);
        if (!measure) continue;
        measure->column = read_column(member, measure->column.coordinate, measure->column.unit);
        branch.measures.push_back(std::move(*measure));
    }
    if (job.model.system && branch.measures.empty() && value.sound())
        value.report("must name the column of at least one measure: \"x.half_range\", \"frequency\", for example");
}

Json branch_columns_document(const Branch& branch, const Writing& at) {
    Json columns = Json::object();
    columns[parameter_name(at.job, branch.parameter)] = fields_document(branch.at, column_fields());
    for (const Branch::Measure& one : branch.measures)
        columns[branch.measure_name(*at.job.model.system, one.measure, one.column.coordinate)] =
            fields_document(one.column, column_fields());
    return columns;
}

void read_branch_range(const ValueReader& value, const Job&, Branch& branch) {
    const Eigen::VectorXd ends = read_numbers(value);
    if (ends.size() != 2) return;
    if (!(ends[0] < ends[1])) return value.report(fmt::format("[{}, {}] must ascend", ends[0], ends[1]));
    branch.range.emplace(ends[0], ends[1]);
}

/// Of the parameter itself: normal, of a known sd. Each motion has one value of it, from which no sd can be told.
void read_branch_parameter_error(const ValueReader& value, const ErrorJob& error, Branch& branch) {
    const bool known = !error.scale.estimate && error.sd_column.empty() && error.scale.value > 0.0;
    if (!known || !std::holds_alternative<estimator::NormalErrors>(error.distribution)) {
        if (value.sound()) value.report("the parameter has normal errors of a known sd: { \"sd\": 0.05 }, for example");
        return;
    }
    branch.at_sd = error.scale.value;
}

/// By the names of measures.
void read_branch_errors(const ValueReader& value, const Job& job, Branch& branch) {
    for (const auto& [name, member] : value.members()) {
        const std::size_t problems_before = member.problem_count();
        const ErrorJob error = read_error(member, job);
        if (branch.parameter >= 0 && name == parameter_name(job, branch.parameter)) {
            read_branch_parameter_error(member, error, branch);
            continue;
        }
        const auto one = std::find_if(branch.measures.begin(), branch.measures.end(), [&, &key = name](const auto& m) {
            return branch.measure_name(*job.model.system, m.measure, m.column.coordinate) == key;
        });
        if (one == branch.measures.end()) {
            if (job.model.system) member.report(fmt::format("\"{}\" is not measured: it has no errors", name));
            continue;
        }
        one->error = error;
        if (std::holds_alternative<estimator::AutoregressiveErrors>(error.distribution) && member.sound() &&
            member.problem_count() == problems_before)
            member.report("measures of different motions are no course in time: \"ar1\" belongs to a series");
    }
}

}  // namespace

const FieldTable<Branch>& measured_branch_fields() {
    static const FieldTable<Branch> table{
        [] {
            auto file = file_field(
                key("file", file_name(), "A table with a row per measured motion: .csv, .tsv, .txt or .mat."),
                &Branch::file);
            file.key.required_always();
            return file;
        }(),
        text_field(key("sha256", sha256(), "Of that file: refused if it has changed."), &Branch::sha256),
        {key("parameter", text(), "Of the model, over which motions were measured; it is not estimated.")
             .required_always(),
         read_branch_parameter,
         [](const Branch& branch, const Writing& at) -> Json { return parameter_name(at.job, branch.parameter); }},
        Field<Branch>{
            key("readings", entries(text() | object(keys_of(reading_fields())), "a name that the model does not have"),
                "Formulas of which measures are columns: { \"tip\": \"h + 0.2 * alpha\" }, or with a unit: "
                "{ \"tip\": { \"formula\": \"h + 0.2 * alpha\", \"unit\": \"m\" } }."),
            read_branch_readings, branch_readings_document}
            .written_if([](const Branch& branch) { return !branch.readings.empty(); }),
        {key("columns",
             entries(column(),
                     "the parameter, a measure x.half_range (max, min, mean, rms) of a coordinate or reading, or "
                     "frequency"),
             "Which column of the table is what; that of the parameter has its name unless given.")
             .required_always(),
         read_branch_columns, branch_columns_document},
        {key("orbit", object(keys_of(orbit_start_fields())),
             "An orbit of the branch at the model's own values, about; of forced models at the phase 0.")
             .required_always(),
         [](const ValueReader& value, const Job& job, Branch& branch) { branch.orbit = read_orbit_start(value, job); },
         [](const Branch& branch, const Writing& at) {
             return fields_document(branch.orbit, orbit_start_fields(), at);
         }},
        {key("range", list(number(), 2, 2, "[lower, upper]"),
             "Of the parameter, over which the branch is followed from that orbit; unless given half as far again as "
             "the motions reach."),
         read_branch_range,
         [](const Branch& branch, const Writing&) {
             return branch.range ? Json::array({branch.range->first, branch.range->second}) : left_out();
         }},
        {errors_key(), read_later<Branch>, [](const Branch& branch, const Writing& at) {
             Json errors = Json::object();
             for (const Branch::Measure& one : branch.measures)
                 errors[branch.measure_name(*at.job.model.system, one.measure, one.column.coordinate)] =
                     error_document(one.error, at);
             if (branch.at_sd > 0.0) errors[parameter_name(at.job, branch.parameter)] = Json{{"sd", branch.at_sd}};
             return errors;
         }}};
    return table;
}

void prepare_branch(ObjectReader& object, const Job& job, Branch&) {
    if (job.model.is(models::Kind::map))
        object.self().report(
            fmt::format("the model {} is a map: its cycles are data of type \"cycles\"", job.model.name));
    if (job.model.system && !job.model.system->inputs().empty())
        object.self().report(fmt::format(
            "the model {} reads measured inputs: its steady states are not periodic by themselves", job.model.name));
}

void complete_branch(ObjectReader& object, const Job& job, bool, Branch& branch) {
    if (const auto errors = object.find("errors")) read_branch_errors(*errors, job, branch);
}

}  // namespace orbid::apps::describe
