#include <algorithm>
#include <cmath>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

/// Labels of segments: texts, or numbers as they stand in the file.
std::vector<std::string> read_labels(const ValueReader& value) {
    std::vector<std::string> result;
    for (const ValueReader& item : value.items()) {
        if (item.is(JsonValue::Kind::number)) result.push_back(fmt::format("{}", item.value().number));
        if (item.is(JsonValue::Kind::string)) result.push_back(item.value().text);
    }
    return result;
}

void read_segments(const ValueReader& value, DataJob& data) {
    ObjectReader segments(value);
    if (const auto predict = segments.find("predict")) data.predict = read_labels(*predict);
    if (const auto fit = segments.find("fit")) {
        if (fit->is(JsonValue::Kind::string)) {
            (void)fit->choice({"all"});
        } else {
            data.fit = read_labels(*fit);
            for (const std::string& label : *data.fit) {
                if (std::find(data.predict.begin(), data.predict.end(), label) == data.predict.end()) continue;
                fit->report(fmt::format("segment {} stands in \"predict\" too", label));
            }
        }
    }
    segments.finish();
}

void read_free_initial_value(ObjectReader& object, InitialValueJob& initial) {
    const auto start = object.find("start");
    if (start) initial.value = start->number();
    if (const auto prior = object.find("prior")) initial.prior = read_prior(*prior).value_or(estimator::Prior{});
    identification::set_default_scale(initial);
    if (object.choose("scale", {"linear", "log"}, initial.scale) && initial.scale == estimator::Scale::log)
        initial.lower = 0.0;
    if (const auto bounds = object.find("bounds")) {
        const auto items = bounds->items();
        if (items.size() == 2) {
            if (!items[0].is(JsonValue::Kind::null)) initial.lower = items[0].number().value_or(initial.lower);
            if (!items[1].is(JsonValue::Kind::null)) initial.upper = items[1].number().value_or(initial.upper);
            if (!(initial.lower < initial.upper))
                bounds->report(
                    fmt::format("lower bound {} must be below the upper bound {}", initial.lower, initial.upper));
        }
        if (initial.scale == estimator::Scale::log && initial.lower < 0.0)
            bounds->report(fmt::format("lower bound {} must be >= 0 on a log scale", initial.lower));
    }
    if (!start || !initial.value) return;
    if (initial.scale == estimator::Scale::log && !(*initial.value > 0.0)) {
        start->report(fmt::format("start {} has no logarithm: give a start > 0", *initial.value));
    } else if (!(initial.lower <= *initial.value && *initial.value <= initial.upper)) {
        start->report(
            fmt::format("start {} lies outside the bounds [{}, {}]", *initial.value, initial.lower, initial.upper));
    } else if (!std::isfinite(estimator::negative_log_density(initial.prior, *initial.value))) {
        start->report(fmt::format("start {} has no density under its prior", *initial.value));
    }
}

InitialValueJob read_initial_value(const ValueReader& value) {
    InitialValueJob initial;
    if (value.is(JsonValue::Kind::string)) {
        (void)value.choice({"estimate"});
        return initial;
    }
    if (value.refused()) return initial;
    ObjectReader object(value);
    if (const auto fixed = object.find("value")) {
        initial.estimate = false;
        initial.value = fixed->number();
        if (!initial.value) initial.value = 0.0;
    } else {
        read_free_initial_value(object, initial);
    }
    object.finish();
    return initial;
}

void read_initial_state(ObjectReader& object, const Job& job, DataJob& data) {
    data.initial_state.resize(coordinate_names(job).size());
    const auto value = object.find("initial_state");
    if (!value) return;
    if (data.sampling() == Sampling::section)
        value->report("holds for samples; a section series has no free initial state in this version");
    for (const auto& [name, member] : value->members()) {
        const auto initial = read_initial_value(member);
        if (const auto index = coordinate_named(name, member, job))
            data.initial_state[static_cast<std::size_t>(*index)] = initial;
    }
}

void read_observe(ObjectReader& object, const Job& job, DataJob& data) {
    std::vector<Eigen::Index> available;
    if (data.file && data.file->table) {
        for (const ColumnJob& column : data.file->columns)
            available.push_back(column.coordinate);
    } else {
        for (std::size_t i = 0; i < coordinate_names(job).size(); ++i)
            available.push_back(static_cast<Eigen::Index>(i));
    }
    data.observe = available;
    const auto value = object.find("observe");
    if (!value) return;
    data.observe.clear();
    for (const auto& [name, item] : read_names(*value)) {
        const auto index = coordinate_named(name, item, job);
        if (!index) continue;
        if (std::find(available.begin(), available.end(), *index) == available.end())
            item.report(fmt::format("\"{}\" is observed, but \"columns\" names no column for it", name));
        data.observe.push_back(*index);
    }
    std::sort(data.observe.begin(), data.observe.end());
}

void read_source(ObjectReader& object, const Job& job, DataJob& data) {
    const auto simulate = object.find("simulate");
    const auto file = object.find("file");
    if (file) {
        data.file.emplace();
        read_file(object, *file, job, *data.file);
    } else if (simulate) {
        data.simulation = read_simulation(*simulate, job);
    } else {
        // That neither is there is reported. Whoever looks at the source finds a simulation without noise.
        data.simulation = simulation_without_noise(job);
    }
}

DataJob read_experiment(const ValueReader& value, const std::string& default_name, const Job& job) {
    DataJob data;
    data.name = default_name;
    ObjectReader object(value);
    object.read("name", data.name);
    read_source(object, job, data);
    read_inputs(object, job, data);
    if (const auto sensor = object.find("sensor")) data.sensor = read_sensor(*sensor, job);
    if (data.simulation && data.sensor.type == models::Sensor::Type::angle_difference && job.model.system) {
        // The difference of two readings has the error of the angle, none of its own.
        if (data.simulation->noise[static_cast<Eigen::Index>(data.sensor.rate)] != 0.0)
            object.report("simulate", "noise of a rate that is a difference of readings must be 0: give the angle's");
        if (data.simulation->noise_correlation[static_cast<Eigen::Index>(data.sensor.angle)] != 0.0)
            object.report("simulate",
                          "noise of an angle that is read twice for a difference cannot be correlated in this version");
    }
    read_observe(object, job, data);
    if (const auto parameters = object.find("parameters")) data.parameters = read_parameter_values(*parameters, job);
    if (const auto free = object.find("free")) {
        for (const auto& [name, item] : read_names(*free))
            if (const auto index = parameter_named(name, item, job)) data.free.push_back(*index);
        std::sort(data.free.begin(), data.free.end());
    }
    if (const auto segments = object.find("segments")) read_segments(*segments, data);
    read_initial_state(object, job, data);
    object.finish();
    return data;
}

}  // namespace

void read_data(ObjectReader& root, Job& job) {
    const auto value = root.find("data");
    if (!value) return;
    std::vector<ValueReader> experiments;
    if (value->is(JsonValue::Kind::array)) {
        experiments = value->items();
    } else if (value->is(JsonValue::Kind::object)) {
        experiments.push_back(*value);
    }
    for (std::size_t i = 0; i < experiments.size(); ++i) {
        DataJob data = read_experiment(experiments[i], fmt::format("run{}", i + 1), job);
        const bool twice = std::any_of(job.data.begin(), job.data.end(),
                                       [&](const DataJob& other) { return other.name == data.name; });
        if (twice) experiments[i].report(fmt::format("there are two experiments named \"{}\"", data.name));
        job.data.push_back(std::move(data));
    }
}

}  // namespace orbid::apps
