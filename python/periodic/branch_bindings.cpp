#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "periodic/branches/continuation.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/properties.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/periodic/orbit_start_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

using periodic::BifurcationDiagram;
using periodic::Branch;
using periodic::BranchPoint;

std::shared_ptr<BifurcationDiagram> follow(const models::System& system, const py::object& guess,
                                           const std::string& parameter, double lower, double upper,
                                           const py::object& period, const py::object& parameters,
                                           const py::object& section, double phase, int direction, double first_step,
                                           double largest_step, std::size_t maximum_points, bool switch_doublings,
                                           bool switch_symmetry, int maximum_period, std::size_t maximum_branches) {
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    periodic::ContinuationOptions options;
    options.parameter = index_of(parameter, parameter_names(system), "parameter");
    options.lower = lower;
    options.upper = upper;
    options.direction = direction;
    options.first_step = first_step;
    options.largest_step = largest_step;
    options.maximum_points = maximum_points;
    options.switch_doublings = switch_doublings;
    options.switch_symmetry = switch_symmetry;
    options.maximum_period = maximum_period;
    options.maximum_branches = maximum_branches;
    const auto start = orbit_start(system, theta, guess, period, section, phase, {}, options.solver.flow);
    auto diagram = std::make_shared<BifurcationDiagram>();
    (void)computed_until_interrupted([&](const std::function<bool()>& stopped) {
        options.interrupted = stopped;
        *diagram = periodic::follow_branches(system, theta, start, options);
    });
    return diagram;
}

py::array_t<double> values(const Branch& branch) {
    std::vector<double> values;
    for (const BranchPoint& point : branch.points)
        values.push_back(point.parameter);
    return array(std::move(values));
}

}  // namespace

void bind_branches(py::module_& module) {
    py::class_<BranchPoint>(module, "BranchPoint", "One orbit of a branch.")
        .def_readonly("parameter", &BranchPoint::parameter)
        .def_readonly("arclength", &BranchPoint::arclength)
        .def_readonly("orbit", &BranchPoint::orbit)
        .def_readonly("unstable", &BranchPoint::unstable, "Multipliers outside the unit circle.")
        .def_property_readonly("bifurcation", name_of(&BranchPoint::bifurcation),
                               "'none', or what happens exactly here.")
        .def_readonly("parameter_error", &BranchPoint::parameter_error);
    py::class_<Branch>(module, "Branch", "A one-parameter family of orbits, in the order of their arclength.")
        .def_property_readonly("values", &values, "Of the parameter, one for each point.")
        .def_readonly("points", &Branch::points)
        .def_property_readonly("first", name_of(&Branch::first))
        .def_property_readonly("last", name_of(&Branch::last), "Why it ended.")
        .def_property_readonly("origin", [](const Branch& branch) -> py::object {
            if (!branch.origin) return py::none();
            return py::make_tuple(branch.origin->branch, branch.origin->point);
        });
    py::class_<BifurcationDiagram, std::shared_ptr<BifurcationDiagram>>(module, "BifurcationDiagram",
                                                                        "Branches of orbits over a parameter.")
        .def_property_readonly("start_status", name_of(&BifurcationDiagram::start_status))
        .def_readonly("branches", &BifurcationDiagram::branches);
    const periodic::ContinuationOptions standard;
    module.def(
        "follow_branches", &follow, py::arg("system"), py::arg("guess"), py::arg("parameter"), py::arg("lower"),
        py::arg("upper"), py::kw_only(), py::arg("period") = py::none(), py::arg("parameters") = py::none(),
        py::arg("section") = py::none(), py::arg("phase") = 0.0, py::arg("direction") = standard.direction,
        py::arg("first_step") = standard.first_step, py::arg("largest_step") = standard.largest_step,
        py::arg("maximum_points") = standard.maximum_points, py::arg("switch_doublings") = standard.switch_doublings,
        py::arg("switch_symmetry") = standard.switch_symmetry, py::arg("maximum_period") = standard.maximum_period,
        py::arg("maximum_branches") = standard.maximum_branches,
        "The branch of orbits through the one near guess (as for periodic_orbit), over a parameter, with its\n"
        "bifurcations and the branches that begin at them. Ctrl-C: what was followed until then.");
}

}  // namespace orbid::python
