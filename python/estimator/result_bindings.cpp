#include "python/estimator/result_bindings.hpp"

#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"
#include "python/conversion/properties.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

using estimator::Estimate;
using estimator::Estimated;
using estimator::EstimatedScale;

py::array_t<double> matrix_array(const Eigen::MatrixXd& matrix) {
    return array(Eigen::MatrixXd(matrix.transpose()));
}

py::array_t<double> vector_array(const Eigen::VectorXd& vector) {
    return array(Eigen::VectorXd(vector));
}

/// One for each residual and block.
template <class Block, class Make>
py::list nested(const std::vector<std::vector<Block>>& values, const Make& make) {
    return listed(values, [&](const auto& blocks) { return listed(blocks, make); });
}

py::array copy_of(const Eigen::VectorXd& vector) {
    return read_only(vector_array(vector));
}

/// Names are unique within an estimate.
py::dict all_by_name(const std::vector<Estimated>& values) {
    return by_name(values, &Estimated::name, [](const Estimated& value) { return py::cast(value); });
}

py::dict scales_by_group(const Estimate& estimate) {
    return by_name(estimate.scales, &EstimatedScale::group,
                   [](const EstimatedScale& scale) { return py::cast(scale); });
}

py::list covariances(const Estimate& estimate) {
    return listed(estimate.covariances, [](const estimator::EstimatedCovariance& one) {
        return py::dict("groups"_a = one.groups, "value"_a = matrix_array(one.value),
                        "sd"_a = matrix_array(one.uncertainty));
    });
}

py::list counts(const Estimate& estimate) {
    return listed(estimate.counts, [](const estimator::ResidualCount& count) {
        return py::dict("type"_a = count.type, "used"_a = count.used, "lost"_a = count.lost,
                        "rejected"_a = count.rejected, "added"_a = count.added, "unused"_a = count.unused);
    });
}

py::list history(const Estimate& estimate) {
    return listed(estimate.history, [](const estimator::StepRecord& step) {
        return py::dict("round"_a = step.round, "block"_a = name(step.block), "accepted"_a = step.accepted,
                        "before"_a = step.before, "after"_a = step.after, "damping"_a = step.damping,
                        "reason"_a = name(step.reason), "provisional"_a = step.provisional);
    });
}

py::list null_directions(const Estimate& estimate) {
    return listed(estimate.null_directions,
                  [](const estimator::NullDirection& direction) { return copy_of(direction.components); });
}

py::list sloppy_directions(const Estimate& estimate) {
    return listed(estimate.sloppy_directions, [](const estimator::SloppyDirection& direction) {
        return py::dict("components"_a = vector_array(direction.components), "sd"_a = direction.sd);
    });
}

py::dict estimated_dict(const Estimated& value) {
    return py::dict("value"_a = value.value, "unit"_a = value.unit, "start"_a = value.start, "sd"_a = value.sd,
                    "interval95"_a = std::vector<double>{value.lower95, value.upper95},
                    "interval_method"_a = name(value.interval_method), "at_bound"_a = name(value.at_bound),
                    "laplace_sd"_a = value.laplace_sd, "data_share"_a = value.data_share, "bias"_a = value.bias);
}

py::dict estimated_dicts(const std::vector<Estimated>& values) {
    return by_name(values, &Estimated::name, estimated_dict);
}

py::dict scale_dict(const EstimatedScale& scale) {
    return py::dict("value"_a = scale.value, "unit"_a = scale.unit, "factor"_a = scale.factor,
                    "estimated"_a = scale.estimated, "sd"_a = scale.uncertainty,
                    "interval95"_a = std::vector<double>{scale.lower95, scale.upper95},
                    "interval_method"_a = name(scale.interval_method), "count"_a = scale.count, "rms"_a = scale.rms,
                    "lag1"_a = scale.lag1, "effective_count"_a = scale.effective_count,
                    "distribution"_a = scale.distribution, "shape"_a = estimated_dicts(scale.shape));
}

std::string shown(const std::string& name, double value, double sd, const std::string& unit) {
    return std::string(py::str("{} = {:.6g} (sd {:.2g}){}").format(name, value, sd, unit.empty() ? "" : " " + unit));
}

using Class = py::class_<EstimateResult, std::shared_ptr<EstimateResult>>;

/// A member of the estimate as a property.
template <class Member>
void member(Class& result, const char* name, Member Estimate::*which, const char* text) {
    result.def_property_readonly(
        name, [which](const EstimateResult& one) { return one.estimate.*which; }, text);
}

/// A property that is made of the estimate.
template <class Make>
void made(Class& result, const char* name, Make make, const char* text) {
    result.def_property_readonly(
        name, [make](const EstimateResult& one) { return make(one.estimate); }, text);
}

void bind_estimated(py::module_& module) {
    py::class_<Estimated>(module, "Estimated", "One estimated or derived number with its uncertainty.")
        .def_readonly("name", &Estimated::name)
        .def_readonly("unit", &Estimated::unit)
        .def_readonly("value", &Estimated::value)
        .def_readonly("start", &Estimated::start)
        .def_readonly("sd", &Estimated::sd, "nan when undetermined: a singular direction, or at a bound")
        .def_property_readonly(
            "interval95", [](const Estimated& one) { return py::make_tuple(one.lower95, one.upper95); },
            "(lower, upper)")
        .def_property_readonly("interval_method", [](const Estimated& one) { return name(one.interval_method); })
        .def_property_readonly(
            "at_bound", [](const Estimated& one) { return name(one.at_bound); }, "\"\", \"lower\" or \"upper\"")
        .def_readonly("laplace_sd", &Estimated::laplace_sd, "sd if errors were independent")
        .def_readonly("data_share", &Estimated::data_share, "of the information; 0: the prior alone decides")
        .def_readonly("bias", &Estimated::bias,
                      "what was taken off: the minimum of the objective is about value + bias")
        .def("__repr__", [](const Estimated& one) { return shown(one.name, one.value, one.sd, one.unit); });
    py::class_<EstimatedScale>(module, "EstimatedScale", "Error scale of a group of records.")
        .def_readonly("group", &EstimatedScale::group)
        .def_readonly("unit", &EstimatedScale::unit)
        .def_readonly("factor", &EstimatedScale::factor)
        .def_readonly("estimated", &EstimatedScale::estimated)
        .def_readonly("value", &EstimatedScale::value)
        .def_readonly("sd", &EstimatedScale::uncertainty, "of the value; 0 when it is fixed")
        .def_property_readonly("interval95",
                               [](const EstimatedScale& one) { return py::make_tuple(one.lower95, one.upper95); })
        .def_property_readonly("interval_method", [](const EstimatedScale& one) { return name(one.interval_method); })
        .def_readonly("count", &EstimatedScale::count, "records")
        .def_readonly("rms", &EstimatedScale::rms)
        .def_readonly("lag1", &EstimatedScale::lag1)
        .def_readonly("effective_count", &EstimatedScale::effective_count)
        .def_readonly("distribution", &EstimatedScale::distribution)
        .def_property_readonly(
            "shape", [](const EstimatedScale& one) { return all_by_name(one.shape); },
            "further parameters of the distribution: dof, relative, correlation")
        .def("__repr__", [](const EstimatedScale& one) {
            return shown(one.group, one.value, one.uncertainty, one.factor ? "" : one.unit);
        });
}

void bind_numbers(Class& result) {
    member(result, "trust_normal", &Estimate::trust_normal, "False: use profiles, marginals or samples");
    member(result, "distrust", &Estimate::distrust, "why not");
    member(result, "objective", &Estimate::objective, "-ln of the posterior density at the estimate");
    member(result, "log_likelihood", &Estimate::log_likelihood, "");
    member(result, "log_integral", &Estimate::log_integral, "");
    member(result, "degrees_of_freedom", &Estimate::degrees_of_freedom, "");
    member(result, "effective_count", &Estimate::effective_count, "");
    member(result, "iterations", &Estimate::iterations, "");
    member(result, "evaluations", &Estimate::evaluations, "");
    member(result, "rounds", &Estimate::rounds, "");
    member(result, "remaining", &Estimate::remaining, "full step that is left, in posterior sds");
}

/// One number of each parameter, in the order of theta.
py::array numbers(const Estimate& estimate, double Estimated::*which) {
    std::vector<double> values;
    for (const Estimated& one : estimate.parameters)
        values.push_back(one.*which);
    return read_only(array(std::move(values)));
}

py::array intervals(const Estimate& estimate) {
    Eigen::MatrixXd values(2, std::ssize(estimate.parameters));
    for (Eigen::Index i = 0; i < values.cols(); ++i) {
        const Estimated& one = estimate.parameters[static_cast<std::size_t>(i)];
        values.col(i) << one.lower95, one.upper95;
    }
    return read_only(array(std::move(values)));
}

}  // namespace

py::dict estimate_dict(const Estimate& estimate) {
    const auto list = [](const auto& array) { return array.attr("tolist")(); };
    return py::dict(
        "status"_a = std::string(name(estimate.status)), "message"_a = estimate.message,
        "parameters"_a = estimated_dicts(estimate.parameters), "derived"_a = estimated_dicts(estimate.derived),
        "scales"_a = by_name(estimate.scales, &EstimatedScale::group, scale_dict),
        "covariance"_a = list(matrix_array(estimate.covariance)),
        "correlation"_a = list(matrix_array(estimate.correlation)),
        "singular_values"_a = list(vector_array(estimate.singular_values)), "trust_normal"_a = estimate.trust_normal,
        "distrust"_a = estimate.distrust, "counts"_a = counts(estimate), "objective"_a = estimate.objective,
        "log_likelihood"_a = estimate.log_likelihood, "log_integral"_a = estimate.log_integral,
        "degrees_of_freedom"_a = estimate.degrees_of_freedom, "effective_count"_a = estimate.effective_count,
        "iterations"_a = estimate.iterations, "evaluations"_a = estimate.evaluations, "rounds"_a = estimate.rounds,
        "remaining"_a = estimate.remaining);
}

void bind_estimate_result(py::module_& module) {
    bind_estimated(module);
    Class result(module, "Estimate", "Result of estimate(); profiles, marginals and samples are asked of it.");
    made(
        result, "status", [](const Estimate& one) { return std::string(name(one.status)); },
        "\"converged\", \"no_progress\", \"iteration_limit\", \"singular\", \"failed\" or \"interrupted\"");
    member(result, "message", &Estimate::message, "why it ended");
    made(
        result, "parameters", [](const Estimate& one) { return all_by_name(one.parameters); },
        "dict of Estimated, in the order of theta");
    made(
        result, "derived", [](const Estimate& one) { return all_by_name(one.derived); }, "");
    made(
        result, "theta", [](const Estimate& one) { return numbers(one, &Estimated::value); },
        "values of the parameters, shape (parameters,)");
    made(
        result, "sds", [](const Estimate& one) { return numbers(one, &Estimated::sd); },
        "of the parameters, shape (parameters,); nan where undetermined");
    made(result, "intervals", intervals, "of 95 %, (lower, upper) in each row, shape (parameters, 2)");
    made(result, "scales", scales_by_group, "dict of EstimatedScale by group");
    made(result, "covariances", covariances, "full covariances of several responses");
    made(
        result, "covariance", [](const Estimate& one) { return read_only(matrix_array(one.covariance)); },
        "of theta in natural units, shape (parameters, parameters)");
    made(
        result, "correlation", [](const Estimate& one) { return read_only(matrix_array(one.correlation)); }, "");
    made(
        result, "singular_values", [](const Estimate& one) { return copy_of(one.singular_values); }, "");
    made(
        result, "latents", [](const Estimate& one) { return nested(one.latents, copy_of); }, "per residual, per block");
    made(
        result, "latent_sds", [](const Estimate& one) { return nested(one.latent_sds, copy_of); }, "");
    made(
        result, "residuals",
        [](const Estimate& one) {
            return nested(one.residuals, [](const estimator::BlockValue& block) { return copy_of(block.e); });
        },
        "errors e at the estimate, per residual, per block");
    made(result, "null_directions", null_directions, "in relative changes of the parameters");
    made(result, "sloppy_directions", sloppy_directions, "products of powers that the data hardly know");
    made(result, "counts", counts,
         "blocks used, lost, rejected, added, and the labels of those that are not used, per residual");
    made(result, "history", history, "every step, accepted or not");
    result.def(
        "to_dict", [](const EstimateResult& one) { return estimate_dict(one.estimate); },
        "All of it but latent states, errors and history as dicts, lists, numbers and texts.");
    bind_numbers(result);
    result.def("__repr__", [](const EstimateResult& one) {
        std::string text = "<Estimate " + std::string(name(one.estimate.status));
        for (const Estimated& value : one.estimate.parameters)
            text += "; " + shown(value.name, value.value, value.sd, value.unit);
        return text + ">";
    });
    bind_estimate_inquiry(result);
}

}  // namespace orbid::python
