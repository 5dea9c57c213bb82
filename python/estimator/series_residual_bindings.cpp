#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include <pybind11/stl.h>

#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/estimator/error_model.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

using orbits::CycleResidual;
using orbits::SeriesResidual;
using orbits::ShootingResidual;

/// Which parameters of the estimate are which of the system: a name or None for each of the estimate's.
models::ParameterBinding binding(const models::System& system, const py::object& parameters, NamedArguments& given) {
    models::ParameterBinding result;
    result.base = parameter_values(system, given.find("values"));
    if (!is_list(parameters))
        throw py::type_error(
            "parameters: needs a list, for each parameter of the estimate its name in the system, or None");
    const std::vector<std::string> names = parameter_names(system);
    for (const py::handle one : parameters) {
        if (!one.is_none()) {
            if (!py::isinstance<py::str>(one)) throw py::type_error("parameters: one is neither text nor None");
            const Eigen::Index index = index_of(one.cast<std::string>(), names, "parameter");
            if (std::find(result.parameter.begin(), result.parameter.end(), index) != result.parameter.end())
                throw py::value_error("parameters: '" + one.cast<std::string>() + "' is named twice");
            result.parameter.push_back(index);
            result.estimated.push_back(result.estimated_count);
        }
        ++result.estimated_count;
    }
    if (result.parameter.empty()) throw py::value_error("parameters: none is the system's");
    return result;
}

/// Scales and forms of the errors of these coordinates.
template <class Options>
void read_errors(Options& options, NamedArguments& given, const std::vector<std::string>& names, bool known_sds) {
    for (const ErrorModel& model : error_models(given.find("errors"), names, "errors")) {
        options.errors.push_back(model.scale);
        orbits::ErrorForm form;
        form.distribution = model.distribution;
        form.floor = model.floor;
        form.known_sds = known_sds;
        options.forms.push_back(form);
    }
}

/// What residuals of a series have in common: name, observe, segments, sensor, errors, known_sds, start and the flow.
template <class Options>
void read_common(Options& options, NamedArguments& given, const models::System& system, const orbits::Series& series) {
    given.take({{"name", options.name}, {"observe", options.observe}, {"segments", options.segments}});
    options.sensor = sensor(given.find("sensor"), system);
    const bool known_sds = given.flag("known_sds", false);
    read_errors(options, given, options.observe.empty() ? coordinate_names(series) : options.observe, known_sds);
    given.take("start", options.start);
    options.flow = flow_options(given, options.flow);
}

std::vector<orbits::InitialStateRule> initial_rules(py::handle description, const models::System& system) {
    std::vector<orbits::InitialStateRule> rules;
    if (!description || description.is_none()) return rules;
    if (!is_mapping(description)) throw py::type_error("initial: needs a dict by coordinate");
    using Kind = orbits::InitialStateRule::Kind;
    rules.resize(static_cast<std::size_t>(system.dimension()));
    for (const auto& [key, value] : mapping(description, "initial")) {
        const std::string name = py::str(key);
        auto& rule = rules[static_cast<std::size_t>(index_of(name, coordinate_names(system), "coordinate"))];
        if (!is_mapping(value)) {
            rule.kind = Kind::fixed;
            rule.value = finite_number(value, "initial: " + name);
            continue;
        }
        NamedArguments given("initial: " + name, value);
        rule.start = given.optional_number("start");
        if (const py::object normal = given.find_value("normal")) {
            NamedArguments density("initial: " + name + ": normal", normal);
            rule.kind = Kind::normal;
            rule.value = density.required_number("mean");
            rule.sd = density.required_number("sd");
            density.finish();
        }
        given.finish();
    }
    return rules;
}

/// Goes with a residual that Python made: how many parameters the estimate has, which the residual itself keeps hidden.
struct MadeHere {
    Eigen::Index parameters = 0;
    void operator()(const SeriesResidual* residual) const { delete residual; }
};

/// The state in which a block begins, of arguments that fit the residual.
py::array_t<double> state(const std::shared_ptr<SeriesResidual>& residual, const py::object& block,
                          const py::object& theta, const py::object& latents) {
    const long long number = whole_number(block, "block");
    const auto blocks = std::ssize(residual->layout());
    if (number < 0 || number >= blocks)
        throw py::value_error("block = " + std::to_string(number) + ": there are " + std::to_string(blocks) +
                              ", counted from 0");
    const auto index = static_cast<std::size_t>(number);
    const auto* made = std::get_deleter<MadeHere>(residual);
    const std::optional<py::ssize_t> parameters = made ? std::optional<py::ssize_t>(made->parameters) : std::nullopt;
    return array(residual->state(index, vector(finite_vector(theta, "theta", parameters)),
                                 vector(finite_vector(latents, "latents", residual->layout()[index].latents))));
}

std::shared_ptr<SeriesResidual> series_residual(const py::object& system, const std::shared_ptr<orbits::Series>& series,
                                                const py::object& parameters, const py::kwargs& keywords) {
    const auto model = system_of(system);
    NamedArguments given("SeriesResidual", keywords);
    models::ParameterBinding bound = binding(*model, parameters, given);
    orbits::SeriesResidualOptions options;
    read_common(options, given, *model, *series);
    options.initial = initial_rules(given.find("initial"), *model);
    given.finish();
    return computed_interruptibly([&] {
        const MadeHere made{bound.estimated_count};
        return std::shared_ptr<SeriesResidual>(new SeriesResidual(model, std::move(bound), *series, std::move(options)),
                                               made);
    });
}

std::shared_ptr<ShootingResidual> shooting_residual(const py::object& system,
                                                    const std::shared_ptr<orbits::Series>& series,
                                                    const py::object& parameters, const py::kwargs& keywords) {
    const auto model = system_of(system);
    NamedArguments given("ShootingResidual", keywords);
    models::ParameterBinding bound = binding(*model, parameters, given);
    orbits::ShootingOptions options;
    read_common(options, given, *model, *series);
    given.take("interval", options.interval);
    using Kind = orbits::Continuity::Kind;
    options.matching.kind = given.word<Kind>(
        "matching", {{"exact", Kind::exact}, {"normal", Kind::normal}, {"student_t", Kind::student_t}}, Kind::exact);
    if (const py::object sd = given.find("matching_sd")) {
        options.matching.estimate = py::isinstance<py::str>(sd) && sd.cast<std::string>() == "estimate";
        if (!options.matching.estimate) options.matching.sd = vector(finite_vector(sd, "matching_sd"));
    }
    given.finish();
    return computed_interruptibly(
        [&] { return std::make_shared<ShootingResidual>(model, std::move(bound), *series, std::move(options)); });
}

std::shared_ptr<CycleResidual> cycle_residual(const py::object& system, const std::vector<orbits::Cycle>& cycles,
                                              const py::object& parameters, const py::object& start,
                                              const py::kwargs& keywords) {
    const auto model = system_of(system);
    NamedArguments given("CycleResidual", keywords);
    if (cycles.empty()) throw py::value_error("cycles: there is none");
    models::ParameterBinding bound = binding(*model, parameters, given);
    const Eigen::VectorXd theta = vector(finite_vector(start, "start", bound.estimated_count));
    orbits::CycleResidualOptions options;
    orbits::SectionPlace place(given.number("phase", 0.0));
    std::vector<std::string> names = coordinate_names(*model);
    if (const py::object section = given.find_value("section")) {
        const auto crossed = plane(*model, section);
        place = orbits::SectionPlace(*crossed);
        for (Eigen::Index i = 0; i < crossed->normal.size(); ++i)
            if (crossed->normal[i] != 0.0 && names.size() == static_cast<std::size_t>(model->dimension()))
                names.erase(names.begin() + i);
    }
    using Weights = orbits::CycleWeights;
    options.targets.weights = given.word<Weights>(
        "weights", {{"covariance", Weights::covariance}, {"equal", Weights::equal}}, Weights::covariance);
    given.take({{"periods", options.targets.periods, 1},
                {"positions", options.targets.positions},
                {"multipliers", options.targets.multipliers},
                {"times", options.targets.times}});
    options.targets.sensor = sensor(given.find("sensor"), *model);
    read_errors(options.targets, given, names, false);
    given.take({{"maximum_move", options.maximum_move}, {"gate", options.gate}});
    options.flow = flow_options(given, options.flow);
    given.finish();
    return computed_interruptibly([&] {
        return std::make_shared<CycleResidual>(model, std::move(bound), cycles, place, theta,
                                               std::vector<Eigen::MatrixXd>{}, options);
    });
}

constexpr auto common_text =
    "\n\nparameters: for each parameter of the estimate its name in the system, or None where it is another "
    "residual's;\n"
    "values: those that are not estimated (dict or array; the model's defaults); sensor as in a job; errors: dict by\n"
    "coordinate with distribution, sd, dof, relative, correlation, floor as in a job; rtol, atol, maximum_steps.";

template <class Kind>
py::class_<Kind, estimator::Residual, std::shared_ptr<Kind>> residual_class(py::module_& module, const char* name,
                                                                            const std::string& text) {
    py::class_<Kind, estimator::Residual, std::shared_ptr<Kind>> result(module, name, (text + common_text).c_str());
    result.def("evaluate", &evaluated, py::arg("theta"), py::arg("latents") = py::none(),
               py::arg("derivatives") = false,
               "Values of all blocks at theta and latent states (those at the start unless given), as of Residual.");
    return result;
}

}  // namespace

void bind_series_residuals(py::module_& module) {
    residual_class<SeriesResidual>(
        module, "SeriesResidual",
        "Samples minus their prediction from one initial state per segment (single shooting).\n\n"
        "name, observe (coordinates), segments (indices), known_sds (the series' deviations count), start (theta at\n"
        "which initial states are guessed); initial: dict by coordinate, a fixed number, {\"start\": ..} or\n"
        "{\"normal\": {\"mean\": .., \"sd\": ..}}.")
        .def(py::init(&series_residual), py::arg("system"), py::arg("series").none(false), py::arg("parameters"))
        .def("state", &state, py::arg("block"), py::arg("theta"), py::arg("latents"),
             "The whole state in which a block begins, shape (n,).");
    residual_class<ShootingResidual>(
        module, "ShootingResidual",
        "A recorded series by multiple shooting: nodes along every segment, matched exactly or with an error.\n\n"
        "name, observe, segments, known_sds, start as of SeriesResidual; interval (0: chosen) from node to node;\n"
        "matching \"exact\", \"normal\" or \"student_t\", matching_sd (shape (n,), or \"estimate\").")
        .def(py::init(&shooting_residual), py::arg("system"), py::arg("series").none(false), py::arg("parameters"))
        .def_property_readonly("interval", &ShootingResidual::interval);
    residual_class<CycleResidual>(module, "CycleResidual",
                                  "Measured cycles against re-solved periodic orbits of the model.\n\n"
                                  "start: theta; phase or section; periods, weights (\"covariance\" or \"equal\"), "
                                  "positions, multipliers, times,\n"
                                  "maximum_move, gate.")
        .def(py::init(&cycle_residual), py::arg("system"), py::arg("cycles"), py::arg("parameters"), py::arg("start"))
        .def_property_readonly("at_rest", &CycleResidual::at_rest, "cycles left out because they are states of rest");
}

}  // namespace orbid::python
