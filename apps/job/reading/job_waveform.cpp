#include <algorithm>
#include <cmath>
#include <numbers>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

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

void read_data_names(ObjectReader& object, const Job& job, WaveformResidualJob& waveform) {
    const auto value = object.find("data");
    if (!value) {
        waveform.data = experiments_with(job, Sampling::samples);
        if (waveform.data.empty()) object.self().report("needs sampled data: an entry of \"data\" with samples");
        return;
    }
    waveform.data = read_experiments(*value, job, [&](const ValueReader& item, const DataJob& data) {
        if (data.sampling() == Sampling::section)
            item.report(fmt::format("\"{}\" is a section series: a waveform needs samples in time", data.name));
    });
    // What is wrong is reported. Otherwise every coordinate would be called unobserved.
    if (waveform.data.empty()) waveform.data = experiments_with(job, Sampling::samples);
}

/// "period" of forced models, "time" of autonomous ones.
void read_length(ObjectReader& object, const Job& job, WaveformResidualJob& waveform) {
    const bool autonomous = job.model.is(models::Kind::autonomous);
    const auto period = object.find("period");
    const auto time = object.find("time");
    if (autonomous && period) {
        period->report(
            fmt::format("the model {} is not forced: give \"time\", a guess of its period in s", job.model.name));
    } else if (period) {
        read_per_experiment(*period, job, waveform.data, [&](const ValueReader& value, std::size_t i) {
            value.read(waveform.experiments[i].period);
        });
    }
    if (!autonomous && time) {
        time->report(
            fmt::format("the model {} is forced: its orbits last \"period\" periods of the forcing", job.model.name));
    } else if (time) {
        const auto found = read_per_experiment(*time, job, waveform.data, [&](const ValueReader& value, std::size_t i) {
            waveform.experiments[i].time = value.number().value_or(1.0);
        });
        for (std::size_t i = 0; i < found.size(); ++i)
            if (!found[i])
                time->report(fmt::format("\"{}\" has no guess of its period", job.data[waveform.data[i]].name));
    } else if (autonomous) {
        object.self().report(
            fmt::format("needs \"time\": a guess of the period in s; the model {} is autonomous and "
                        "nothing else tells it",
                        job.model.name));
    }
}

void read_phase(ObjectReader& object, const Job& job, WaveformResidualJob& waveform) {
    const auto phase = object.find("phase");
    if (!phase) return;
    const bool autonomous = job.model.is(models::Kind::autonomous);
    read_per_experiment(*phase, job, waveform.data, [&](const ValueReader& value, std::size_t i) {
        WaveformResidualJob::Experiment& experiment = waveform.experiments[i];
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

/// "start": { "run1": [[...], ...] }: states at phase 0, one per period of the orbit.
void read_starts(ObjectReader& object, const Job& job, WaveformResidualJob& waveform) {
    const auto start = object.find("start");
    if (!start || !job.model.system) return;
    const auto names = experiment_names(job, waveform.data);
    for (const auto& [name, member] : start->members()) {
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

void read_waveform(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    WaveformResidualJob waveform;
    if (job.model.is(models::Kind::map))
        object.self().report(
            fmt::format("the model {} is a map: it has no waveforms in time; use its cycles", job.model.name));
    if (job.model.system && !job.model.system->inputs().empty())
        object.self().report(
            fmt::format("the model {} reads measured inputs: its steady states are not periodic by "
                        "themselves",
                        job.model.name));
    read_data_names(object, job, waveform);
    waveform.experiments.resize(waveform.data.size());
    read_length(object, job, waveform);
    read_phase(object, job, waveform);
    read_starts(object, job, waveform);
    ErrorUse use;
    use.records = ErrorUse::Records::series;
    use.data = waveform.data;
    for (const std::size_t index : waveform.data)
        use.add_coordinates(job.data[index].observe);
    read_errors(object, use, job, waveform.errors, waveform.covariances);
    read_offset(object, job, waveform.errors, waveform);
    if (estimate.waveform)
        object.self().report(fmt::format("a second residual of type waveform: {}", not_in_this_version));
    estimate.waveform = std::move(waveform);
}

}  // namespace orbid::apps
