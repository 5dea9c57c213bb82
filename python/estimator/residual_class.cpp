#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "python/conversion/arrays.hpp"
#include "python/conversion/properties.hpp"
#include "python/estimator/python_residual.hpp"
#include "python/estimator/result_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

constexpr auto residual_text =
    R"(A source of errors e = y - yhat(theta, z) with derivatives; subclass it to bring one of your own.

A subclass calls super().__init__() and has the methods

groups()    list of dicts, one for each set of records with a common error distribution: name, unit, and as in a job
            distribution, sd, dof, relative, correlation, floor; interval (records in order at this distance).
layout()    list of dicts, one for each block of records that share latent states: records (their number; group 0 or
            "group"), or groups (the group of each record); label, latents, deviation, shape, observed, constraints,
            next, linked_from, constraint_size, active.
evaluate(theta, latents, derivatives)
            list with one dict for each block, or the dict of the only one: "e", shape (records,), and when
            `derivatives` is true "e_theta", shape (records, parameters), "e_z", shape (records, latents), and where the
            block has them e_next, c, c_theta, c_z, c_next. None, or errors that are not finite: the block cannot be
            evaluated there, and the step is shortened.

and where they are needed type(), structure() ("none", "independent_blocks", "chain", "cyclic_chain"), covariances(),
initial_latents(), update_active_set(theta, latents, scales), is_intermediate_stage(). Methods are called holding the
interpreter's lock, from threads that are not the caller's. profiles(), marginals() and sample() call evaluate() from
several threads: one call may begin where another gives up the lock, in NumPy or between two lines, so evaluate() leaves
nothing in self that another call of it reads. An exception stops the estimate and is raised there.)";

py::dict value_dict(const estimator::BlockValue& value, bool derivatives) {
    py::dict dict;
    dict["status"] = value.status == estimator::BlockStatus::ok ? "ok" : "failed";
    dict["e"] = array(Eigen::VectorXd(value.e));
    const auto add = [&](const char* name, const Eigen::MatrixXd& matrix) {
        if (derivatives && matrix.size() > 0) dict[name] = array(Eigen::MatrixXd(matrix.transpose()));
    };
    if (value.c.size() > 0) dict["c"] = array(Eigen::VectorXd(value.c));
    add("e_theta", value.e_theta);
    add("e_z", value.e_z);
    add("e_next", value.e_next);
    add("c_theta", value.c_theta);
    add("c_z", value.c_z);
    add("c_next", value.c_next);
    return dict;
}

}  // namespace

py::list evaluated(const estimator::Residual& residual, py::handle theta, py::handle latents, bool derivatives) {
    if (dynamic_cast<const PythonResidual*>(&residual) != nullptr)
        throw py::type_error("evaluate() is to be written by the subclass");
    const Eigen::VectorXd parameters = vector(finite_vector(theta, "theta"));
    const estimator::ActiveSet active = residual.initial_set();
    std::vector<Eigen::VectorXd> states = active.latents;
    if (!latents.is_none()) {
        const auto given = py::reinterpret_borrow<py::sequence>(latents);
        if (given.size() != states.size())
            throw py::value_error("latents: " + std::to_string(given.size()) + " vectors, needs one for each of " +
                                  std::to_string(states.size()) + " blocks");
        for (std::size_t b = 0; b < states.size(); ++b) {
            const py::object one = given[b];
            states[b] = vector(finite_vector(one, "latents", states[b].size()));
        }
    }
    return listed(unlocked([&] { return residual.evaluate(active, parameters, states, derivatives); }),
                  [&](const estimator::BlockValue& value) { return value_dict(value, derivatives); });
}

void bind_residual(py::module_& module) {
    py::class_<estimator::Residual, PythonResidual, std::shared_ptr<estimator::Residual>>(module, "Residual",
                                                                                          residual_text)
        .def(py::init_alias<>())
        .def("evaluate", &evaluated, py::arg("theta"), py::arg("latents") = py::none(), py::arg("derivatives") = false,
             "Values of all blocks at theta (natural units, in the order of the estimate's parameters) and latent "
             "states (those at the start unless given).");
}

}  // namespace orbid::python
