#include <algorithm>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"

namespace orbid::apps {

std::vector<ResidualType> EstimateJob::residual_types() const {
    std::vector<ResidualType> present;
    if (cycles) present.push_back(ResidualType::cycles);
    if (series) present.push_back(ResidualType::series);
    if (waveform) present.push_back(ResidualType::waveform);
    if (branch) present.push_back(ResidualType::branch);
    return present;
}

namespace describe {

namespace {

using Json = nlohmann::ordered_json;

void read_cycle_periods(const ValueReader& value, const Job& job, CyclesResidualJob& cycles) {
    cycles.periods = read_periods(value).value_or(cycles.periods);
    if (!job.orbits || job.orbits->file) return;
    const auto& found = job.orbits->search.periods;
    for (const int period : cycles.periods)
        if (std::find(found.begin(), found.end(), period) == found.end())
            value.report(fmt::format("period {} is not searched for: it does not stand in /orbits/periods", period));
}

const FieldTable<CyclesResidualJob>& cycles_fields() {
    using Cycles = CyclesResidualJob;
    static const FieldTable<Cycles> table = [] {
        FieldTable<Cycles> fields{
            Field<Cycles>{key("periods", periods(),
                              "Periods of the cycles that are used; unless given all that are searched for."),
                          read_cycle_periods,
                          [](const Cycles& cycles, const Writing&) -> Json { return cycles.periods; }}
                // Empty: all periods of a file of cycles.
                .written_if([](const Cycles& cycles) { return !cycles.periods.empty(); }),
            word_field(key("weights", {}, "Covariance of the cycles from the analysis, or one sd for all."),
                       {{true, "covariance"}, {false, "equal"}}, &Cycles::covariance),
            field(key("positions", boolean(), "The points are data."), &Cycles::positions),
            field(key("multipliers", boolean(), "ln|multiplier| is data."), &Cycles::multipliers),
            {key("times", boolean(), "Autonomous models: the time in which a cycle closes is data.")
                 .standard_text("true"),
             [](const ValueReader& value, const Job& job, Cycles& cycles) {
                 cycles.times = value.boolean().value_or(cycles.times);
                 if (cycles.times && job.model.system && !job.model.is(models::Kind::autonomous))
                     value.report(fmt::format("the model {} is not autonomous: its cycles have no time of their own",
                                              job.model.name));
             },
             [](const Cycles& cycles, const Writing& at) {
                 return at.job.model.is(models::Kind::autonomous) ? Json(cycles.times) : left_out();
             }}};
        add_error_fields(fields);
        return fields;
    }();
    return table;
}

/// Cycles of an autonomous model are points of a plane in its states.
void check_crossings(ObjectReader& object, const Job& job) {
    if (job.orbits->embedding) {
        object.self().report(
            "compares states, but points of the cycles are vectors of delayed readings: compare their readings by "
            "{ \"type\": \"waveform\", \"of\": \"cycles\" }");
    } else if (!job.section_plane && (job.orbits->file || !job.section_from_data)) {
        object.self().report(fmt::format(
            "the model {} is autonomous: needs a \"section\" in the job that its cycles cross: {{ \"coordinate\": ..., "
            "\"value\": ..., \"direction\": ... }}",
            job.model.name));
    }
}

void prepare_cycles(ObjectReader& object, const Job& job, CyclesResidualJob& cycles) {
    if (!job.orbits) object.self().report("needs \"orbits\": { ... }, a search for cycles or a file of them");
    cycles.times = job.model.is(models::Kind::autonomous);
    if (cycles.times && job.orbits) check_crossings(object, job);
    if (job.orbits && !job.orbits->file) cycles.periods = job.orbits->search.periods;
}

void complete_cycles(ObjectReader& object, const Job& job, bool, CyclesResidualJob& cycles) {
    if (!cycles.positions && !cycles.multipliers && !cycles.times)
        object.find("positions")
            ->report(job.model.is(models::Kind::autonomous)
                         ? "must be true without \"multipliers\" or \"times\": nothing is left to compare"
                         : "must be true without \"multipliers\": true: nothing is left to compare");
    ErrorUse use;
    if (cycles.multipliers) use.multipliers = &cycles.multiplier_error;
    if (cycles.times) use.times = &cycles.time_error;
    use.records = cycles.covariance ? ErrorUse::Records::cycles_with_covariance : ErrorUse::Records::cycles;
    for (std::size_t i = 0; i < coordinate_names(job).size(); ++i)
        if (!job.section_plane || job.section_plane->coordinate != static_cast<Eigen::Index>(i))
            use.coordinates.push_back(static_cast<Eigen::Index>(i));
    read_errors(object, use, job, cycles.errors, cycles.covariances);
}

/// How a type of residual is read: `prepare` before its keys, `complete` after them.
template <class Residual>
struct ResidualReading {
    const FieldTable<Residual>& fields;
    void (*prepare)(ObjectReader& object, const Job& job, Residual& residual);
    void (*complete)(ObjectReader& object, const Job& job, bool staged, Residual& residual);

    void read(ObjectReader& object, const Job& job, bool staged, std::optional<Residual>& target) const {
        Residual residual;
        prepare(object, job, residual);
        read_fields(object, fields, residual, job);
        complete(object, job, staged, residual);
        object.finish();
        if (target)
            object.self().report(fmt::format("a second residual of type {}: {}", object.find("type")->value().text,
                                             not_in_this_version));
        target = std::move(residual);
    }
};

void check_branch_parameter(ObjectReader& object, const EstimateJob& estimate) {
    for (const FreeParameterJob& free : estimate.parameters)
        if (free.parameter == estimate.branch->parameter)
            object.find("parameter")
                ->report(fmt::format("{} is estimated: the parameter of a branch is known", free.value.name));
}

void read_residuals(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    const bool staged = estimate.automatic;
    for (const ValueReader& item : value.items()) {
        ObjectReader object(item);
        const auto type = object.find("type");
        const auto choice = type ? type->choice(residual_type_names) : std::nullopt;
        if (!choice) continue;  // without the type every other key would be called unknown
        switch (static_cast<ResidualType>(*choice)) {
            case ResidualType::cycles:
                ResidualReading<CyclesResidualJob>{cycles_fields(), prepare_cycles, complete_cycles}.read(
                    object, job, staged, estimate.cycles);
                break;
            case ResidualType::series:
                ResidualReading<SeriesResidualJob>{series_fields(), prepare_series, complete_series}.read(
                    object, job, staged, estimate.series);
                break;
            case ResidualType::waveform:
                ResidualReading<WaveformResidualJob>{waveform_fields(), prepare_waveform, complete_waveform}.read(
                    object, job, staged, estimate.waveform);
                break;
            case ResidualType::branch:
                ResidualReading<BranchResidualJob>{measured_branch_fields(), prepare_branch, complete_branch}.read(
                    object, job, staged, estimate.branch);
                check_branch_parameter(object, estimate);
                break;
        }
    }
    if (const auto present = estimate.residual_types(); !present.empty())
        estimate.strategy = {{StageJob::Kind::residuals, present}};
}

template <class Residual>
void add_document(Json& residuals, ResidualType type, const std::optional<Residual>& residual,
                  const FieldTable<Residual>& fields, const Writing& at) {
    if (!residual) return;
    Json object{{"type", name_of(type, residual_type_names)}};
    object.update(fields_document(*residual, fields, at));
    residuals.push_back(std::move(object));
}

/// Adds the keys of a type, and says of each which types have it.
template <class Residual>
void add_keys(std::vector<KeySchema>& keys, ResidualType type, const FieldTable<Residual>& fields) {
    const std::string& name = name_of(type, residual_type_names);
    for (KeySchema& one : keys_of(fields)) {
        const auto known =
            std::find_if(keys.begin(), keys.end(), [&](const KeySchema& other) { return other.key == one.key; });
        if (known != keys.end()) {
            known->only_with->values.push_back(name);
        } else {
            keys.push_back(one.with("type", {name}));
        }
    }
}

ValueSchema residual() {
    std::vector<KeySchema> keys;
    add_keys(keys, ResidualType::cycles, cycles_fields());
    add_keys(keys, ResidualType::series, series_fields());
    add_keys(keys, ResidualType::waveform, waveform_fields());
    add_keys(keys, ResidualType::branch, measured_branch_fields());
    const auto common = std::stable_partition(keys.begin(), keys.end(), [](const KeySchema& one) {
        return one.only_with->values.size() < residual_type_names.size();
    });
    std::for_each(common, keys.end(), [](KeySchema& one) { one.only_with.reset(); });
    keys.insert(keys.begin(), key("type", choice(residual_type_names),
                                  "What is compared: points of cycles, a recorded series, measured periodic steady "
                                  "states, or their amplitudes "
                                  "and frequencies over a parameter.")
                                  .required_always());
    return named("residual", object(keys));
}

ValueSchema residuals() {
    return list(residual(), 1);
}

}  // namespace

Json experiments_document(const std::vector<std::size_t>& data, const Writing& at) {
    return json_list(data, [&](std::size_t index) { return at.job.data[index].name; });
}

void add_usual_residuals(const ValueReader& at, const Job& job, EstimateJob& estimate) {
    static const ValueSchema described = residuals();
    JsonValue list;
    list.kind = JsonValue::Kind::array;
    list.place = at.value().place;
    const auto add = [&](const char* name) {
        JsonValue type;
        type.kind = JsonValue::Kind::string;
        type.text = name;
        type.place = list.place;
        JsonValue residual;
        residual.kind = JsonValue::Kind::object;
        residual.place = list.place;
        residual.members.push_back({"type", list.place, type});
        list.items.push_back(std::move(residual));
    };
    if (job.orbits) add("cycles");
    if (!std::all_of(job.data.begin(), job.data.end(), [](const DataJob& data) { return data.streamed(); }))
        add("series");
    if (list.items.empty()) {
        at.report("\"auto\" needs \"data\", or \"orbits\" with a file of cycles, to estimate from");
        return;
    }
    read_residuals(at.standing_for(list, &described), job, estimate);
}

Field<EstimateJob> residuals_field() {
    return {key("residuals", residuals(), "What is compared; not needed with \"strategy\": \"auto\"."), read_residuals,
            [](const EstimateJob& estimate, const Writing& at) {
                Json list = Json::array();
                add_document(list, ResidualType::cycles, estimate.cycles, cycles_fields(), at);
                add_document(list, ResidualType::series, estimate.series, series_fields(), at);
                add_document(list, ResidualType::waveform, estimate.waveform, waveform_fields(), at);
                add_document(list, ResidualType::branch, estimate.branch, measured_branch_fields(), at);
                return list;
            }};
}

}  // namespace describe

}  // namespace orbid::apps
