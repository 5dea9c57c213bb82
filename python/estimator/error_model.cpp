#include "python/estimator/error_model.hpp"

#include <limits>
#include <utility>

#include <pybind11/stl.h>

#include "python/conversion/arguments.hpp"
#include "python/conversion/named_arguments.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

/// The one key of {"normal": {...}} and what it holds.
std::pair<std::string, py::object> only_entry(py::handle description, const std::string& where, const char* wanted) {
    if (!is_mapping(description) || py::len(description) != 1)
        throw py::type_error(where + ": needs a dict with one key, " + wanted);
    const py::dict entries = mapping(description, where);
    const auto entry = *entries.begin();
    return {py::str(entry.first), py::reinterpret_borrow<py::object>(entry.second)};
}

estimator::ErrorScale error_scale(py::handle value, const std::string& where) {
    // From the residuals on unless a start is given.
    const estimator::ErrorParameter sd = error_parameter(value, 0.0, where);
    return {sd.estimate, sd.value, sd.prior};
}

}  // namespace

estimator::Prior prior(py::handle description, const std::string& where) {
    if (!description || description.is_none()) return estimator::FlatPrior{};
    if (py::isinstance<py::str>(description)) {
        if (description.cast<std::string>() == "flat") return estimator::FlatPrior{};
        throw py::value_error(where + ": prior '" + description.cast<std::string>() +
                              "': \"flat\" or a dict is needed, as {\"normal\": {\"mean\": 0, \"sd\": 1}}");
    }
    constexpr auto known = "normal, lognormal, uniform, half_normal, half_cauchy, gamma or student_t";
    const auto [form, numbers] = only_entry(description, where, known);
    NamedArguments given(where + ": " + form, numbers);
    estimator::Prior result;
    if (form == "normal")
        result = estimator::NormalPrior{given.required_number("mean"), given.required_number("sd")};
    else if (form == "lognormal")
        result = estimator::LogNormalPrior{given.required_number("median"), given.required_number("log_sd")};
    else if (form == "uniform")
        result = estimator::UniformPrior{given.required_number("lower"), given.required_number("upper")};
    else if (form == "half_normal")
        result = estimator::HalfNormalPrior{given.required_number("scale")};
    else if (form == "half_cauchy")
        result = estimator::HalfCauchyPrior{given.required_number("scale")};
    else if (form == "gamma")
        result = estimator::GammaPrior{given.required_number("shape"), given.required_number("rate")};
    else if (form == "student_t")
        result = estimator::StudentPrior{given.required_number("dof"), given.required_number("location"),
                                         given.required_number("scale")};
    else
        throw py::value_error(where + ": no prior '" + form + "'; known are " + known);
    given.finish();
    try {
        estimator::validate(result);
    } catch (const std::invalid_argument& error) {
        throw py::value_error(where + ": " + error.what());
    }
    return result;
}

estimator::JointNormalPrior joint_prior(py::handle description, const std::string& where) {
    const auto [form, numbers] = only_entry(description, where, "normal");
    if (form != "normal") throw py::value_error(where + ": no joint prior '" + form + "'; known is normal");
    NamedArguments given(where + ": normal", numbers);
    estimator::JointNormalPrior result{given.texts("names"), given.vector("mean"), given.matrix("covariance")};
    given.finish();
    estimator::validate(result);
    return result;
}

estimator::ErrorParameter error_parameter(py::handle value, double start, const std::string& where) {
    estimator::ErrorParameter result{true, start, estimator::FlatPrior{}};
    if (!value || value.is_none()) return result;
    if (py::isinstance<py::str>(value)) {
        if (value.cast<std::string>() == "estimate") return result;
        throw py::value_error(where + " = '" + value.cast<std::string>() +
                              "': a number, \"estimate\" or {\"estimate\": {\"start\": .., \"prior\": ..}} is needed");
    }
    if (!is_mapping(value)) {
        result.estimate = false;
        result.value = finite_number(value, where);
        return result;
    }
    NamedArguments given(where, value);
    const py::object inner = given.find("estimate");
    given.finish();
    if (!inner) throw py::type_error(where + ": 'estimate' is missing");
    NamedArguments how(where + ": estimate", inner);
    result.value = how.number("start", start);
    result.prior = prior(how.find("prior"), where);
    how.finish();
    return result;
}

ErrorModel error_model(NamedArguments& description, const std::string& where) {
    const std::size_t form =
        description.choice("distribution", {"normal", "student_t", "laplace", "lognormal", "relative", "ar1"});
    ErrorModel result;
    const auto parameter = [&](const char* name, std::size_t belongs_to, estimator::ErrorParameter& value) {
        if (!description.has(name)) return;
        if (form != belongs_to) throw py::value_error(where + ": '" + name + "' belongs to another distribution");
        value = error_parameter(description.find(name), value.value, where + ": " + name);
    };
    estimator::StudentErrors student;
    estimator::RelativeErrors relative;
    estimator::AutoregressiveErrors autoregressive;
    parameter("dof", 1, student.dof);
    parameter("relative", 4, relative.relative);
    parameter("correlation", 5, autoregressive.correlation);
    const estimator::ErrorDistribution forms[] = {estimator::NormalErrors{},    student,  estimator::LaplaceErrors{},
                                                  estimator::LogNormalErrors{}, relative, autoregressive};
    result.distribution = forms[form];
    result.scale = error_scale(description.find("sd"), where + ": sd");
    result.floor = description.number("floor", 0.0);
    if (!(result.floor >= 0.0))
        throw py::value_error(where + ": floor = " + std::to_string(result.floor) + ", must be >= 0");
    return result;
}

std::vector<ErrorModel> error_models(py::handle descriptions, const std::vector<std::string>& names,
                                     const std::string& where) {
    std::vector<ErrorModel> result(names.size());
    for (ErrorModel& model : result)
        model.scale.value = 0.0;
    if (!descriptions || descriptions.is_none()) return result;
    if (!is_mapping(descriptions)) throw py::type_error(where + ": needs a dict with one entry for each coordinate");
    for (const auto& [key, value] : mapping(descriptions, where)) {
        const std::string name = py::str(key);
        const auto place = static_cast<std::size_t>(index_of(name, names, "coordinate"));
        NamedArguments given(where + ": " + name, value);
        result[place] = error_model(given, where + ": " + name);
        given.finish();
    }
    return result;
}

estimator::Group group(py::handle description, std::size_t number) {
    std::string where = "group " + std::to_string(number);
    NamedArguments given(where, description);
    estimator::Group result;
    given.take("name", result.name);
    if (result.name.empty()) throw py::type_error(where + ": 'name' is missing");
    where = "group '" + result.name + "'";
    given.take("unit", result.unit);
    ErrorModel errors = error_model(given, where);
    result.scale = errors.scale;
    result.distribution = errors.distribution;
    result.floor = errors.floor;
    given.take("factor", result.factor);
    if (const auto interval = given.optional_number("interval")) {
        if (!(*interval > 0.0)) throw py::value_error(where + ": interval must be > 0");
        result.ordered = true;
        result.interval = *interval;
    }
    given.take("interval_unit", result.interval_unit);
    given.finish();
    return result;
}

bool read_bounds(NamedArguments& given, const std::string& where, double& lower, double& upper) {
    const py::object bounds = given.find_value("bounds");
    if (!bounds) return false;
    if (!is_list(bounds) || py::len(bounds) != 2)
        throw py::value_error(where + ": bounds: needs [lower, upper], None where there is none");
    const auto bound = [&](int place, double none) {
        const py::object value = bounds[py::int_(place)];
        if (value.is_none() || (PyFloat_Check(value.ptr()) && value.cast<double>() == none)) return none;
        return finite_number(value, where + ": bounds");
    };
    constexpr double infinite = std::numeric_limits<double>::infinity();
    lower = bound(0, -infinite);
    upper = bound(1, infinite);
    return true;
}

estimator::FreeParameter free_parameter(estimator::FreeParameter usual, py::handle description, bool known) {
    const std::string where = "parameter '" + usual.name + "'";
    if (!is_mapping(description)) {
        usual.start = finite_number(description, where);
        return usual;
    }
    NamedArguments given(where, description);
    given.take("unit", usual.unit);
    if (const py::object tied = given.find_value("tied")) {
        if (py::isinstance<py::str>(tied)) {
            usual.tied_to = tied.cast<std::string>();
        } else {
            NamedArguments how(where + ": tied", tied);
            how.take({{"to", usual.tied_to}, {"factor", usual.tie_factor}});
            how.finish();
            if (usual.tied_to.empty()) throw py::type_error(where + ": tied: 'to' is missing");
        }
        given.finish();
        return usual;
    }
    usual.start = known ? given.number("start", usual.start) : given.required_number("start");
    using estimator::Scale;
    usual.scale = given.word<Scale>(
        "scale", {{"linear", Scale::linear}, {"log", Scale::log}, {"log10", Scale::log10}, {"logit", Scale::logit}},
        usual.scale);
    if (!read_bounds(given, where, usual.lower, usual.upper) &&
        (usual.scale == Scale::log || usual.scale == Scale::log10))
        usual.lower = 0.0;
    usual.prior = prior(given.find("prior"), where + ": prior");
    given.take("typical_size", usual.typical_size);
    given.finish();
    return usual;
}

std::vector<estimator::JointNormalPrior> joint_priors(NamedArguments& given) {
    std::vector<estimator::JointNormalPrior> result;
    const py::object priors = given.find_value("joint_priors");
    if (!priors) return result;
    if (!py::isinstance<py::sequence>(priors)) throw py::type_error(given.place("joint_priors") + ": needs a list");
    for (const py::handle one : priors)
        result.push_back(joint_prior(one, given.place("joint_priors")));
    return result;
}

std::vector<estimator::FreeParameter> estimated_parameters(py::handle parameters) {
    if (!parameters || !is_mapping(parameters))
        throw py::type_error("parameters: needs a dict from names to start values, or to dicts with \"start\"");
    std::vector<estimator::FreeParameter> result;
    for (const auto& [key, value] : mapping(parameters, "parameters")) {
        estimator::FreeParameter usual;
        usual.name = key.cast<std::string>();
        result.push_back(free_parameter(std::move(usual), value, false));
    }
    if (result.empty()) throw py::value_error("parameters: there is none");
    return result;
}

}  // namespace orbid::python
