#include "python/identification/problem_arguments.hpp"

#include <algorithm>
#include <utility>

#include <pybind11/stl.h>

#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/estimator/error_model.hpp"
#include "python/estimator/result_bindings.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
namespace id = identification;

namespace {

std::vector<Eigen::Index> indices_of(const std::vector<std::string>& chosen, const std::vector<std::string>& names,
                                     const std::string& what) {
    std::vector<Eigen::Index> indices;
    for (const std::string& name : chosen)
        indices.push_back(index_of(name, names, what));
    return indices;
}

/// "estimate", a number, or a dict with value, or with start, prior, scale and bounds.
id::InitialValue initial_value(py::handle value, const std::string& where) {
    id::InitialValue result;
    if (py::isinstance<py::str>(value) && value.cast<std::string>() == "estimate") return result;
    if (!is_mapping(value)) {
        result.estimate = false;
        result.value = finite_number(value, where);
        return result;
    }
    NamedArguments given(where, value);
    if (given.has("value")) {
        result.estimate = false;
        result.value = given.required_number("value");
    } else {
        given.take("start", result.value);
        result.prior = prior(given.find("prior"), where + ": prior");
        id::set_default_scale(result);
        using estimator::Scale;
        result.scale = given.word<Scale>("scale", {{"linear", Scale::linear}, {"log", Scale::log}}, result.scale);
        if (result.scale == Scale::log) result.lower = 0.0;
        read_bounds(given, where, result.lower, result.upper);
    }
    given.finish();
    return result;
}

/// Error models by coordinate for what one of the experiments observes; with known sds a fixed factor of 1 on them.
std::vector<id::RecordErrors> record_errors(NamedArguments& given, const id::IdentificationProblem& problem,
                                            const std::vector<std::size_t>& data) {
    std::vector<Eigen::Index> observed;
    for (const std::size_t e : data)
        observed.insert(observed.end(), problem.experiments[e].observe.begin(), problem.experiments[e].observe.end());
    std::sort(observed.begin(), observed.end());
    observed.erase(std::unique(observed.begin(), observed.end()), observed.end());
    std::vector<std::string> names;
    for (const Eigen::Index coordinate : observed)
        names.emplace_back(problem.coordinate(coordinate).name);
    const py::object described = given.find_value("errors");
    const bool known = given.flag("known_sds", false);
    const std::vector<ErrorModel> models = error_models(described, names, given.place("errors"));
    std::vector<id::RecordErrors> errors;
    for (std::size_t k = 0; k < models.size(); ++k) {
        id::RecordErrors& one = errors.emplace_back();
        one = {observed[k], models[k].scale, models[k].distribution, models[k].floor, known ? "deviations" : ""};
        if (known && (!described || !mapping(described, "errors").contains(names[k].c_str())))
            one.scale = {false, 1.0, estimator::FlatPrior{}};
    }
    return errors;
}

/// Indices of the experiments named; those of samples, otherwise all, unless any is named.
std::vector<std::size_t> experiments(NamedArguments& given, const id::IdentificationProblem& problem) {
    std::vector<std::string> names;
    std::vector<std::size_t> samples, chosen;
    for (const id::Experiment& one : problem.experiments) {
        if (one.series->sampling == orbits::Series::Sampling::samples) samples.push_back(names.size());
        names.push_back(one.name);
    }
    for (const std::string& name : given.texts("data"))
        chosen.push_back(static_cast<std::size_t>(index_of(name, names, "experiment")));
    if (!chosen.empty()) return chosen;
    if (!samples.empty()) return samples;
    for (std::size_t e = 0; e < names.size(); ++e)
        chosen.push_back(e);
    return chosen;
}

id::Matching matching(py::handle value, const std::string& where) {
    using Kind = id::Matching::Kind;
    if (!value || value.is_none()) return {};
    if (py::isinstance<py::str>(value)) {
        constexpr Kind kinds[] = {Kind::automatic, Kind::exact};
        return {kinds[choice_of(value.cast<std::string>(), {"auto", "exact"}, where)], 0.0};
    }
    NamedArguments given(where, value);
    const py::object sd = given.find("sd");
    given.finish();
    if (!sd) throw py::type_error(where + ": 'sd' is missing");
    if (py::isinstance<py::str>(sd) && sd.cast<std::string>() == "estimate") return {Kind::estimated, 0.0};
    return {Kind::given, finite_number(sd, where + ": sd")};
}

/// dynamics={"noise": "none" | "estimate"}
bool noise_is_estimated(NamedArguments& given) {
    const py::object described = given.find_value("dynamics");
    if (!described) return false;
    NamedArguments dynamics(given.place("dynamics"), described);
    const py::object noise = dynamics.find("noise");
    dynamics.finish();
    if (!noise || !py::isinstance<py::str>(noise))
        throw py::type_error(given.place("dynamics") + ": 'noise' must be \"none\" or \"estimate\"");
    return choice_of(noise.cast<std::string>(), {"none", "estimate"}, given.place("dynamics") + ": noise") == 1;
}

id::SeriesChoice series_choice(NamedArguments& given, const id::IdentificationProblem& problem) {
    id::SeriesChoice result;
    result.data = experiments(given, problem);
    result.interval = id::SeriesChoice::automatic_interval;
    if (const py::object interval = given.find_value("interval")) {
        if (!py::isinstance<py::str>(interval))
            result.interval = static_cast<std::size_t>(whole_number(interval, given.place("interval"), 1));
        else if (choice_of(interval.cast<std::string>(), {"auto", "segment"}, given.place("interval")) == 1)
            result.interval.reset();
    }
    result.matching = matching(given.find("matching"), given.place("matching"));
    if (noise_is_estimated(given)) {
        if (!result.interval || result.matching.kind != id::Matching::Kind::automatic)
            throw py::value_error(given.place("dynamics") +
                                  ": process noise acts between nodes that need not meet: "
                                  "leave out 'matching' and interval=\"segment\"");
        result.matching = {id::Matching::Kind::diffusion, 0.0};
    }
    result.errors = record_errors(given, problem, result.data);
    return result;
}

orbits::CycleTargetOptions cycle_choice(NamedArguments& given, const id::IdentificationProblem& problem) {
    orbits::CycleTargetOptions result;
    using Weights = orbits::CycleWeights;
    result.weights = given.word<Weights>("weights", {{"covariance", Weights::covariance}, {"equal", Weights::equal}},
                                         result.weights);
    const auto& plane = problem.measured.plane;
    result.times = plane.has_value();
    given.take({{"periods", result.periods, 1},
                {"positions", result.positions},
                {"multipliers", result.multipliers},
                {"times", result.times}});
    if (problem.measured.experiment) result.sensor = problem.experiments[*problem.measured.experiment].sensor;
    if (const py::object errors = given.find_value("errors")) {
        // The plane's coordinate is the same at all points.
        std::vector<std::string> names;
        for (Eigen::Index k = 0; k < problem.system->dimension(); ++k)
            if (!plane || plane->normal[k] == 0.0) names.emplace_back(problem.coordinate(k).name);
        for (const ErrorModel& one : error_models(errors, names, given.place("errors"))) {
            result.errors.push_back(one.scale);
            result.forms.push_back({one.distribution, one.floor});
        }
    }
    return result;
}

/// A measured steady state of one period for all of its experiments.
id::WaveformChoice waveform_choice(NamedArguments& given, const id::IdentificationProblem& problem) {
    id::WaveformChoice result;
    result.data = experiments(given, problem);
    result.errors = record_errors(given, problem, result.data);
    id::WaveformChoice::Experiment one;
    given.take({{"period", one.period, 1}, {"time", one.time}});
    const estimator::ErrorParameter phase = error_parameter(given.find("phase"), 0.0, given.place("phase"));
    one.phase = {phase.estimate, phase.value};
    result.experiments.assign(result.data.size(), one);
    return result;
}

/// Cycles that were found or measured, and the only section among the records as the one they are from.
void read_cycles(NamedArguments& given, id::IdentificationProblem& problem) {
    const py::object cycles = given.find_value("cycles");
    const py::object search = given.find_value("search");
    const py::object section = given.find_value("section");
    if (!cycles) {
        if (search) throw py::value_error("search: without cycles; see orbid.find_cycles()");
        if (section) throw py::value_error("section: without cycles, whose points lie on it; see orbid.find_cycles()");
        return;
    }
    id::MeasuredCycles& measured = problem.measured;
    if (section) measured.plane = plane(*problem.system, section);
    if (py::isinstance<orbits::CycleSearch>(cycles))
        measured.search = cycles.cast<const orbits::CycleSearch&>();
    else
        measured.search.cycles = cycles.cast<std::vector<orbits::Cycle>>();
    for (std::size_t e = 0; e < problem.experiments.size() && !measured.experiment; ++e) {
        const auto& series = problem.experiments[e].series;
        if (series->sampling != orbits::Series::Sampling::section) continue;
        measured.experiment = e;
        measured.section = series;
        measured.section_phase = series->phase;
    }
    if (!search || !measured.section) return;
    NamedArguments how("search", search);
    measured.options = search_options(how, coordinate_names(*measured.section));
    how.finish();
}

void read_residuals(NamedArguments& given, id::IdentificationProblem& problem) {
    const py::object residuals = given.find_value("residuals");
    if (!residuals) return;
    if (!is_list(residuals)) throw py::type_error("residuals: needs a list of dicts with \"type\"");
    std::size_t number = 0;
    for (const py::handle item : residuals) {
        NamedArguments one("residuals[" + std::to_string(number++) + "]", item);
        if (!one.has("type")) throw py::type_error(one.place("type") + " is missing");
        const std::size_t type = one.choice("type", {"cycles", "series", "waveform"});
        if (type == 0   ? problem.cycles.has_value()
            : type == 1 ? problem.series.has_value()
                        : problem.waveform.has_value())
            throw py::value_error(one.place("type") + ": named twice");
        if (type == 0) problem.cycles = cycle_choice(one, problem);
        if (type == 1) problem.series = series_choice(one, problem);
        if (type == 2) problem.waveform = waveform_choice(one, problem);
        one.finish();
    }
}

id::Stage stage(py::handle item) {
    using Kind = id::Stage::Kind;
    using Type = id::ResidualType;
    constexpr Type types[] = {Type::cycles, Type::series, Type::waveform};
    if (py::isinstance<py::str>(item)) {
        const auto word = choice_of(item.cast<std::string>(), {"cycles", "series", "waveform", "prediction", "harvest"},
                                    "stage of the strategy");
        if (word == 3) return {Kind::prediction, {}};
        if (word == 4) return {Kind::harvest, {Type::cycles}};
        return {Kind::residuals, {types[word]}};
    }
    id::Stage together;
    for (const std::string& word : text_list(item, "strategy"))
        together.residuals.push_back(
            types[choice_of(word, {"cycles", "series", "waveform"}, "residual of the strategy")]);
    return together;
}

}  // namespace

id::Experiment experiment(py::handle description, const models::System& system, std::size_t number) {
    NamedArguments given("records[" + std::to_string(number) + "]", description);
    id::Experiment result;
    result.name = given.text("name", "run" + std::to_string(number + 1));
    const py::object record = given.find("record");
    if (!record || !py::isinstance<orbits::Series>(record))
        throw py::type_error(given.place("record") + ": needs a Series");
    result.series = record.cast<std::shared_ptr<orbits::Series>>();
    result.sensor = sensor(given.find("sensor"), system);
    const auto coordinates = coordinate_names(system);
    result.observe = indices_of(given.texts("observe"), coordinates, "coordinate");
    if (result.observe.empty())
        for (const std::string& name : coordinate_names(*result.series))
            result.observe.push_back(index_of(name, coordinates, "coordinate"));
    std::sort(result.observe.begin(), result.observe.end());
    const auto names = parameter_names(system);
    if (const py::object own = given.find_value("parameters"))
        for (const auto& [key, value] : mapping(own, given.place("parameters")))
            result.parameters.push_back({index_of(key.cast<std::string>(), names, "parameter"),
                                         finite_number(value, given.place("parameters"))});
    result.free = indices_of(given.texts("free"), names, "parameter");
    if (given.has("fit")) result.fit = given.texts("fit");
    given.take({{"predict", result.predict}, {"simulated", result.follows_model}});
    if (const py::object initial = given.find_value("initial_state")) {
        result.initial_state.resize(coordinates.size());
        for (const auto& [key, value] : mapping(initial, given.place("initial_state"))) {
            const auto name = key.cast<std::string>();
            const auto place = static_cast<std::size_t>(index_of(name, coordinates, "coordinate"));
            result.initial_state[place] = initial_value(value, given.place("initial_state") + ": " + name);
        }
    }
    given.finish();
    return result;
}

std::vector<id::FreeModelParameter> model_parameters(py::handle parameters, const models::System& system) {
    std::vector<id::FreeModelParameter> result;
    const auto names = parameter_names(system);
    for (const auto& [key, value] : mapping(parameters, "parameters")) {
        const auto name = key.cast<std::string>();
        const Eigen::Index index = index_of(name, names, "parameter");
        id::FreeModelParameter usual = id::free_parameter(system, name, system.default_parameters()[index]);
        usual.value = free_parameter(std::move(usual.value), value, true);
        // The bounds of a domain depend on the scale, which may be another than usual.
        if (!is_mapping(value) || !value.contains("bounds"))
            id::set_default_bounds(system.parameters()[static_cast<std::size_t>(index)], usual.value);
        result.push_back(std::move(usual));
    }
    return result;
}

void read_problem(NamedArguments& given, id::IdentificationProblem& problem) {
    problem.values = parameter_values(*problem.system, given.find("values"));
    const auto names = parameter_names(*problem.system);
    if (const py::object derived = given.find_value("derived"))
        for (const auto& [key, formula] : mapping(derived, "derived"))
            problem.derived.push_back(
                {key.cast<std::string>(), models::Expression::parse(formula.cast<std::string>(), names)});
    problem.joint_priors = joint_priors(given);
    read_cycles(given, problem);
    read_residuals(given, problem);
}

id::Options identification_options(NamedArguments& given) {
    id::Options options;
    const py::object strategy = given.find_value("strategy");
    if (strategy && !(py::isinstance<py::str>(strategy) && strategy.cast<std::string>() == "auto")) {
        if (!is_list(strategy)) throw py::type_error("strategy: needs \"auto\" or a list of stages");
        for (const py::handle item : strategy) {
            if (!py::isinstance<py::dict>(item)) {
                options.strategy.push_back(stage(item));
                continue;
            }
            NamedArguments needed("strategy", item);
            const py::object stages = needed.find("if_needed");
            if (!stages || !is_list(stages))
                throw py::type_error("strategy: a dict needs \"if_needed\", a list of stages");
            for (const py::handle one : stages) {
                options.strategy.push_back(stage(one));
                options.strategy.back().if_needed = true;
            }
            needed.finish();
        }
    }
    options.variance = variance(given);
    given.take({{"scan", options.scan},
                {"seed", options.seed},
                {"step_tolerance", options.step_tolerance},
                {"starts", options.starts, 1}});
    options.start_seed = options.seed;
    given.take("start_seed", options.start_seed);
    return options;
}

}  // namespace orbid::python
