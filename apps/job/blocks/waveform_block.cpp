#include <algorithm>
#include <cmath>
#include <numbers>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Sampling = orbits::Series::Sampling;
using Waveform = WaveformResidualJob;

std::vector<std::string> experiment_names(const Job& job, const std::vector<std::size_t>& data) {
    std::vector<std::string> names;
    for (const std::size_t index : data)
        names.push_back(job.data[index].name);
    return names;
}

/// One value for all experiments, or { "run1": ..., "run2": ... }; `read` is given the value and the position of its
/// experiment in `data`. @return the experiments that have one, by position.
template <class Read>
std::vector<bool> read_per_experiment(const ValueReader& value, const Job& job, const std::vector<std::size_t>& data,
                                      Read read) {
    std::vector<bool> found(data.size(), false);
    const auto names = experiment_names(job, data);
    const bool named =
        value.is(JsonValue::Kind::object) && !value.value().members.empty() &&
        std::any_of(value.value().members.begin(), value.value().members.end(), [&](const JsonMember& member) {
            return std::find(names.begin(), names.end(), member.key) != names.end();
        });
    if (!named) {
        for (std::size_t i = 0; i < data.size(); ++i) {
            const std::size_t problems_before = value.problem_count();
            read(value, i);
            found[i] = true;
            // What is wrong for one is wrong for all.
            if (value.problem_count() > problems_before) return std::vector<bool>(data.size(), true);
        }
        return found;
    }
    for (const auto& [name, member] : value.members()) {
        const auto at = std::find(names.begin(), names.end(), name);
        if (at == names.end()) {
            member.report(fmt::format("\"{}\" is no experiment of this residual{}", name, suggestion(name, names)));
            continue;
        }
        const auto i = static_cast<std::size_t>(at - names.begin());
        read(member, i);
        found[i] = true;
    }
    return found;
}

/// One value for all experiments, or one per experiment.
ValueSchema per_experiment(const ValueSchema& value) {
    return value | entries(value, "an experiment");
}

/// One value per experiment that has some.
template <class Write>
Json per_experiment_document(const Waveform& waveform, const Writing& at, Write write) {
    Json object = Json::object();
    for (std::size_t i = 0; i < waveform.data.size(); ++i)
        if (Json value = write(waveform.experiments[i]); !value.is_discarded())
            object[at.job.data[waveform.data[i]].name] = std::move(value);
    return object.empty() ? left_out() : object;
}

Json unknown_document(const periodic::WaveformUnknown& unknown) {
    return unknown.estimate ? Json("estimate") : Json(unknown.value);
}

void use_samples(const ValueReader& value, const Job& job, Waveform& waveform) {
    for (const auto& [name, item] : read_names(value)) {
        const auto data = std::find_if(job.data.begin(), job.data.end(),
                                       [&, &text = name](const DataJob& one) { return one.name == text; });
        if (data != job.data.end() && data->sampling() == Sampling::section)
            item.report(fmt::format("\"{}\" is a section series: a waveform needs samples in time", name));
    }
    // What is wrong is reported. Otherwise every coordinate would be called unobserved.
    if (waveform.data.empty()) waveform.data = experiments_with(job, Sampling::samples);
    waveform.experiments.resize(waveform.data.size());
}

void read_waveform_period(const ValueReader& value, const Job& job, Waveform& waveform) {
    if (job.model.is(models::Kind::autonomous)) {
        value.report(
            fmt::format("the model {} is not forced: give \"time\", a guess of its period in s", job.model.name));
        return;
    }
    read_per_experiment(value, job, waveform.data,
                        [&](const ValueReader& one, std::size_t i) { one.read(waveform.experiments[i].period); });
}

void read_time(const ValueReader& value, const Job& job, Waveform& waveform) {
    if (!job.model.is(models::Kind::autonomous)) {
        value.report(
            fmt::format("the model {} is forced: its orbits last \"period\" periods of the forcing", job.model.name));
        return;
    }
    (void)read_per_experiment(value, job, waveform.data, [&](const ValueReader& one, std::size_t i) {
        if (one.is(JsonValue::Kind::string))
            (void)one.choice({"auto"});
        else
            waveform.experiments[i].time = one.number().value_or(1.0);
    });
}

void read_phase(const ValueReader& phase, const Job& job, Waveform& waveform) {
    const bool autonomous = job.model.is(models::Kind::autonomous);
    read_per_experiment(phase, job, waveform.data, [&](const ValueReader& value, std::size_t i) {
        Waveform::Experiment& experiment = waveform.experiments[i];
        if (value.is(JsonValue::Kind::string)) {
            (void)value.choice({"estimate"});
            return;
        }
        if (!value.is(JsonValue::Kind::number)) return;
        if (autonomous) {
            value.report("must be \"estimate\": nothing drives an autonomous model, so that nothing tells its phase");
            return;
        }
        const double turn = 2.0 * std::numbers::pi * experiment.period;
        const auto number = value.number([&](double x) { return std::abs(x) <= turn; },
                                         fmt::format("within +- {} rad, the whole orbit", turn));
        experiment.phase = {false, number.value_or(0.0)};
    });
}

void read_offset(ObjectReader& object, const Job& job, const std::vector<ErrorJob>& errors,
                 WaveformResidualJob& waveform) {
    const auto offset = object.find("offset");
    const std::vector<periodic::WaveformUnknown> none(errors.size(), periodic::WaveformUnknown{false, 0.0});
    for (auto& experiment : waveform.experiments)
        experiment.offsets = none;
    if (!offset) return;
    const auto read_one = [](const ValueReader& value, periodic::WaveformUnknown& unknown) {
        if (value.is(JsonValue::Kind::number)) {
            unknown = {false, value.value().number};
        } else if (value.is(JsonValue::Kind::string)) {
            unknown = {value.choice({"estimate", "none"}) == 0, 0.0};
        }
    };
    if (offset->is(JsonValue::Kind::string)) {
        const bool all = offset->choice({"estimate", "none"}) == 0;
        for (std::size_t i = 0; i < waveform.data.size(); ++i)
            for (std::size_t c = 0; c < errors.size(); ++c)
                waveform.experiments[i].offsets[c].estimate =
                    all && job.data[waveform.data[i]].observes(errors[c].coordinate);
        return;
    }
    for (const auto& [name, member] : offset->members()) {
        const auto index = coordinate_named(name, member, job);
        if (!index) continue;
        const auto error =
            std::find_if(errors.begin(), errors.end(), [&](const ErrorJob& one) { return one.coordinate == *index; });
        if (error == errors.end()) {
            member.report(fmt::format("\"{}\" is not observed: it has no offset", name));
            continue;
        }
        const auto c = static_cast<std::size_t>(error - errors.begin());
        for (std::size_t i = 0; i < waveform.data.size(); ++i) {
            const std::size_t problems_before = member.problem_count();
            if (!job.data[waveform.data[i]].observes(error->coordinate)) continue;
            read_one(member, waveform.experiments[i].offsets[c]);
            if (member.problem_count() > problems_before) break;
        }
    }
}

Json offset_document(const Waveform& waveform, const Writing& at) {
    // One value for all experiments that observe a coordinate: so they are read.
    Json object = Json::object();
    for (std::size_t c = 0; c < waveform.errors.size(); ++c) {
        const Eigen::Index coordinate = waveform.errors[c].coordinate;
        for (std::size_t i = 0; i < waveform.data.size(); ++i) {
            if (!at.job.data[waveform.data[i]].observes(coordinate)) continue;
            object[coordinate_name(at.job, coordinate)] = unknown_document(waveform.experiments[i].offsets[c]);
            break;
        }
    }
    return object;
}

/// { "run1": [[...], ...] }: states at phase 0, one per period of the orbit.
void read_starts(const ValueReader& value, const Job& job, Waveform& waveform) {
    if (!job.model.system) return;
    const auto names = experiment_names(job, waveform.data);
    for (const auto& [name, member] : value.members()) {
        const auto at = std::find(names.begin(), names.end(), name);
        if (at == names.end()) {
            member.report(fmt::format("\"{}\" is no experiment of this residual{}", name, suggestion(name, names)));
            continue;
        }
        auto& experiment = waveform.experiments[static_cast<std::size_t>(at - names.begin())];
        const auto items = member.items();
        if (member.is(JsonValue::Kind::array) && items.size() != static_cast<std::size_t>(experiment.period))
            member.report(fmt::format("must hold one state at phase 0 per period of the orbit: {}, not {}",
                                      experiment.period, items.size()));
        experiment.start.resize(job.model.system->dimension(), static_cast<Eigen::Index>(items.size()));
        for (std::size_t j = 0; j < items.size(); ++j)
            experiment.start.col(static_cast<Eigen::Index>(j)) =
                read_state(items[j], job).value_or(Eigen::VectorXd::Zero(job.model.system->dimension()));
    }
}

}  // namespace

const FieldTable<Waveform>& waveform_fields() {
    using Experiment = Waveform::Experiment;
    static const FieldTable<Waveform> table = [] {
        FieldTable<Waveform> fields{
            experiments_field<Waveform>().with_rule(use_samples),
            word_field(
                key("of", {},
                    "Autonomous models: the records themselves, or the cycles that \"orbits\" finds in one, whose "
                    "errors are factors on those of the analysis."),
                {{false, "records"}, {true, "cycles"}}, &Waveform::of_cycles)
                .written_if([](const Waveform& waveform) { return waveform.of_cycles; }),
            {key("period", per_experiment(whole(1, longest_period)), "Forced models: in periods of the forcing.")
                 .by_default(1),
             read_waveform_period,
             [](const Waveform& waveform, const Writing& at) {
                 if (at.job.model.is(models::Kind::autonomous)) return left_out();
                 return per_experiment_document(waveform, at, [](const Experiment& one) -> Json { return one.period; });
             }},
            {key("time", per_experiment(above(0.0) | choice({"auto"})),
                 "Autonomous models: a guess of the period; \"auto\": told from the record.")
                 .in("s")
                 .by_default("auto"),
             read_time,
             [](const Waveform& waveform, const Writing& at) {
                 if (!at.job.model.is(models::Kind::autonomous)) return left_out();
                 return per_experiment_document(waveform, at, [](const Experiment& one) -> Json {
                     return one.time > 0.0 ? Json(one.time) : Json("auto");
                 });
             }},
            {key("phase", per_experiment(number() | choice({"estimate"})),
                 "Of the forcing at the time 0 of the record.")
                 .in("rad")
                 .by_default("estimate"),
             read_phase,
             [](const Waveform& waveform, const Writing& at) {
                 return per_experiment_document(waveform, at,
                                                [](const Experiment& one) { return unknown_document(one.phase); });
             }},
            Field<Waveform>{key("offset",
                                choice({"estimate", "none"}) |
                                    entries(number() | choice({"estimate", "none"}), "an observed coordinate"),
                                "A constant that the readings are off by, in the coordinate's unit.")
                                .by_default("none"),
                            read_later<Waveform>, offset_document}
                .written_after("start"),
            {key("start", entries(list(state()), "an experiment"), "States at phase 0, one per period of the orbit."),
             read_starts, [](const Waveform& waveform, const Writing& at) {
                 return per_experiment_document(waveform, at, [](const Experiment& one) {
                     return one.start.cols() > 0 ? columns_document(one.start) : left_out();
                 });
             }}};
        add_error_fields(fields);
        return fields;
    }();
    return table;
}

void prepare_waveform(ObjectReader& object, const Job& job, Waveform& waveform) {
    if (job.model.is(models::Kind::map))
        object.self().report(
            fmt::format("the model {} is a map: it has no waveforms in time; use its cycles", job.model.name));
    if (job.model.system && !job.model.system->inputs().empty())
        object.self().report(
            fmt::format("the model {} reads measured inputs: its steady states are not periodic by "
                        "themselves",
                        job.model.name));
    if (object.find("data")) return;
    waveform.data = experiments_with(job, Sampling::samples);
    waveform.experiments.resize(waveform.data.size());
    if (waveform.data.empty()) object.self().report("needs sampled data: an entry of \"data\" with samples");
}

namespace {

/// What waveforms of cycles need, and what they have no use for.
void check_cycles(ObjectReader& object, const Job& job, Waveform& waveform) {
    const auto of = object.find("of");
    if (job.model.system && !job.model.is(models::Kind::autonomous))
        of->report(
            fmt::format("must be \"records\": the model {} is {}, whose cycles a residual of type cycles compares",
                        job.model.name, job.model.is(models::Kind::map) ? "a map" : "forced"));
    for (const char* name : {"period", "time", "phase", "offset", "start"})
        if (const auto value = object.find(name))
            value->report("belongs to records: a cycle begins and lasts as the search tells");
    if (!job.orbits || job.orbits->file) {
        of->report("needs \"orbits\": { ... }, a search for cycles in a record of samples");
        return;
    }
    if (job.orbits->data >= job.data.size()) return;  // has been told
    if (job.data[job.orbits->data].sampling() != Sampling::samples)
        of->report(fmt::format("needs samples in time, but \"{}\" holds sections", job.data[job.orbits->data].name));
    waveform.data = {job.orbits->data};
    waveform.experiments.assign(1, {});
    for (const Eigen::Index coordinate : job.data[job.orbits->data].observe)
        if (job.model.coordinate(coordinate).angle)
            of->report_later(fmt::format("the waveform of {}, which is an angle, along a cycle",
                                         job.model.coordinate(coordinate).name));
}

}  // namespace

void complete_waveform(ObjectReader& object, const Job& job, bool, Waveform& waveform) {
    if (waveform.of_cycles) check_cycles(object, job, waveform);
    ErrorUse use;
    use.records = ErrorUse::Records::series;
    use.data = waveform.data;
    for (const std::size_t index : waveform.data)
        use.add_coordinates(job.data[index].observe);
    read_errors(object, use, job, waveform.errors, waveform.covariances);
    read_offset(object, job, waveform.errors, waveform);
}

}  // namespace orbid::apps::describe
