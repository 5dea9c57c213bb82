#include "periodic/solution/solve_orbit.hpp"

#include <algorithm>

#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "periodic/search/orbit_search.hpp"
#include "periodic/stability/stability.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/properties.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/periodic/orbit_start_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

using periodic::PeriodicOrbit;

const PeriodicOrbit& orbit_of(const py::object& self) {
    return self.cast<const PeriodicOrbit&>();
}

void bind_orbit(py::module_& module) {
    py::class_<PeriodicOrbit, std::shared_ptr<PeriodicOrbit>>(module, "PeriodicOrbit", "A periodic orbit.")
        .def_property_readonly("status", name_of(&PeriodicOrbit::status))
        .def_property_readonly(
            "converged", [](const PeriodicOrbit& orbit) { return orbit.status == periodic::OrbitStatus::converged; })
        .def_readonly("period", &PeriodicOrbit::period, "In periods of the forcing, iterations or crossings.")
        .def_readonly("rotation", &PeriodicOrbit::rotation, "Turns per orbit, one per angle coordinate.")
        .def_property_readonly("points", memory_of(&PeriodicOrbit::points), "Shape (p, n), angles in (-pi, pi].")
        .def_property_readonly("times", memory_of(&PeriodicOrbit::times),
                               "Shape (p,): of each point since the first [s].")
        .def_readonly("time", &PeriodicOrbit::time, "Duration of the orbit [s]; iterations of a map.")
        .def_property_readonly("multipliers", memory_of(&PeriodicOrbit::multipliers),
                               "Floquet multipliers, largest modulus first, without the trivial one.")
        .def_readonly("trivial_multiplier", &PeriodicOrbit::trivial_multiplier)
        .def_property_readonly(
            "jacobians",
            [](const py::object& self) {
                return listed(orbit_of(self).jacobians, [&](const Eigen::MatrixXd& jacobian) -> py::object {
                    return view(jacobian, self).attr("T");
                });
            },
            "Derivatives from each point to the next, shape (n, n) each.")
        .def_property_readonly(
            "sensitivities",
            [](const py::object& self) {
                const PeriodicOrbit& orbit = orbit_of(self);
                const auto points = orbit.points.cols(), n = orbit.points.rows();
                const auto rows = view(orbit.sensitivities, self);
                return rows.attr("reshape")(orbit.sensitivities.cols(), points, n).attr("transpose")(1, 2, 0);
            },
            "Shape (p, n, f): derivatives of the points by the parameters asked for.")
        .def_property_readonly(
            "time_sensitivities",
            [](const PeriodicOrbit& orbit) {
                return read_only(array(Eigen::VectorXd(orbit.time_sensitivities.transpose())));
            },
            "Shape (f,): of the duration, autonomous models.")
        .def_readonly("residual", &PeriodicOrbit::residual, "Largest closing error.")
        .def_readonly("iterations", &PeriodicOrbit::iterations)
        .def_readonly("distance", &PeriodicOrbit::distance, "Largest move of a point from its guess, relative.")
        .def_readonly("sticking", &PeriodicOrbit::sticking)
        .def_readonly("repeats", &PeriodicOrbit::repeats, "Times the orbit asked for runs through the one found.")
        .def_readonly("discretisation_error", &PeriodicOrbit::discretisation_error)
        .def("__repr__", [](const PeriodicOrbit& orbit) {
            return "PeriodicOrbit(" + std::string(name(orbit.status)) + ", period " + std::to_string(orbit.period) +
                   ", " + std::to_string(orbit.points.cols()) + " points)";
        });
}

std::shared_ptr<PeriodicOrbit> solve(const models::System& system, const py::object& guess, const py::object& period,
                                     const py::object& parameters, const std::string& method,
                                     const py::object& sensitivities, const py::object& section, double phase,
                                     const std::vector<int>& rotation, double tolerance, int maximum_iterations,
                                     double maximum_distance, std::optional<int> nodes) {
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    const auto free = free_parameters(system, sensitivities).value_or(std::vector<Eigen::Index>{});
    periodic::ShootingOptions solver;
    solver.tolerance = tolerance;
    solver.maximum_iterations = maximum_iterations;
    solver.maximum_distance = maximum_distance;
    const periodic::StartingSolution start =
        orbit_start(system, theta, guess, period, section, phase, rotation, solver.flow);
    const auto chosen = choice_of(method, {"multiple_shooting", "finite_difference", "collocation"}, "method");
    periodic::OrbitMethod options = solver;
    if (chosen == 0 && nodes) throw py::value_error("nodes: of finite_difference and collocation");
    if (chosen == 1) {
        periodic::FiniteDifferenceOptions differences;
        differences.solver = solver;
        differences.nodes = nodes.value_or(differences.nodes);
        options = differences;
    } else if (chosen == 2) {
        periodic::CollocationOptions collocation;
        collocation.solver = solver;
        collocation.intervals = nodes.value_or(collocation.intervals);
        options = collocation;
    }
    const py::gil_scoped_release unlocked;
    return std::make_shared<PeriodicOrbit>(periodic::solve_orbit(system, theta, start, free, options));
}

void bind_stability(py::module_& module) {
    using periodic::Stability;
    py::class_<Stability>(module, "Stability", "How an orbit attracts and repels.")
        .def_readonly("simulated", &Stability::simulated)
        .def_readonly("unstable", &Stability::unstable, "Number of multipliers outside the unit circle.")
        .def_property_readonly("nearest", name_of(&Stability::nearest))
        .def_readonly("distance", &Stability::distance, "Smallest distance of a modulus from 1.")
        .def_readonly("directions", &Stability::directions,
                      "At each point the eigenvectors, shape (n, number of multipliers), complex.")
        .def_readonly("ln_multiplier_sensitivities", &Stability::ln_multiplier_sensitivities,
                      "d ln|multiplier| / d parameter, shape (number of multipliers, f).");
    module.def(
        "stability",
        [](const models::System& system, const PeriodicOrbit& orbit, const py::object& parameters,
           const py::object& sensitivities, double phase, double near) {
            const Eigen::VectorXd theta = parameter_values(system, parameters);
            const auto free = free_parameters(system, sensitivities).value_or(std::vector<Eigen::Index>{});
            const py::gil_scoped_release unlocked;
            return periodic::stability(system, theta, phase, orbit, free, {.near = near, .flow = {}});
        },
        py::arg("system"), py::arg("orbit"), py::arg("parameters") = py::none(), py::kw_only(),
        py::arg("sensitivities") = false, py::arg("phase") = 0.0, py::arg("near") = periodic::StabilityOptions{}.near,
        "Directions and nearest bifurcation of a converged orbit. sensitivities: the names that the orbit was solved "
        "with.");
}

struct Search {
    std::shared_ptr<periodic::OrbitSearch> found;
    std::vector<int> periods;
};

Search find(const models::System& system, const std::vector<int>& periods, const py::object& parameters,
            const py::object& section, double phase, std::uint64_t seed, std::size_t points, std::size_t trajectories,
            const py::object& initial, bool symmetry, bool stabilised) {
    const Eigen::VectorXd theta = parameter_values(system, parameters);
    periodic::OrbitSearchOptions options;
    options.periods = periods;
    options.phase = phase;
    options.section = plane(system, section);
    options.seed = seed;
    options.points = points;
    options.trajectories = trajectories;
    if (!initial.is_none()) options.initial = matrix(records(initial, "initial", system.dimension()));
    options.symmetry = symmetry;
    options.stabilised = stabilised;
    auto found = std::make_shared<periodic::OrbitSearch>();
    (void)computed_until_interrupted([&](const std::function<bool()>& stopped) {
        options.interrupted = stopped;
        *found = periodic::search_orbits(system, theta, options);
    });
    std::vector<int> ascending = periods;
    std::sort(ascending.begin(), ascending.end());
    return {found, ascending};
}

void bind_search(py::module_& module) {
    using periodic::FoundOrbit;
    py::class_<FoundOrbit>(module, "FoundOrbit", "A prime periodic orbit that was found.")
        .def_readonly("orbit", &FoundOrbit::orbit)
        .def_property_readonly("origin", name_of(&FoundOrbit::origin))
        .def_readonly("mirror", &FoundOrbit::mirror, "Number of its mirror image, -1: not known.")
        .def_readonly("hits", &FoundOrbit::hits, "Starts that led to it.");
    py::class_<Search>(module, "OrbitSearch", "What a search for periodic orbits found.")
        .def_property_readonly(
            "orbits", [](const Search& search) -> const std::vector<FoundOrbit>& { return search.found->orbits; })
        .def_property_readonly(
            "settled",
            [](const Search& search) {
                py::dict settled;
                for (std::size_t k = 0; k < search.found->settled.size(); ++k)
                    settled[py::int_(search.periods[k])] = bool(search.found->settled[k]);
                return settled;
            },
            "For each period: the last round of starts found nothing new.")
        .def_property_readonly("starts", [](const Search& search) { return search.found->starts; })
        .def_property_readonly("captured", [](const Search& search) { return search.found->captured; })
        .def_property_readonly("interrupted", [](const Search& search) { return search.found->interrupted; });
    const periodic::OrbitSearchOptions standard;
    module.def("find_orbits", &find, py::arg("system"), py::arg("periods"), py::arg("parameters") = py::none(),
               py::kw_only(), py::arg("section") = py::none(), py::arg("phase") = 0.0, py::arg("seed") = standard.seed,
               py::arg("points") = standard.points, py::arg("trajectories") = standard.trajectories,
               py::arg("initial") = py::none(), py::arg("symmetry") = standard.symmetry,
               py::arg("stabilised") = standard.stabilised,
               "All prime periodic orbits of these periods that can be reached without data. Ctrl-C: what was found "
               "until then.");
}

}  // namespace

void bind_periodic(py::module_& module) {
    bind_orbit(module);
    const periodic::ShootingOptions standard;
    module.def("periodic_orbit", &solve, py::arg("system"), py::arg("guess"), py::arg("period") = py::none(),
               py::arg("parameters") = py::none(), py::kw_only(), py::arg("method") = "multiple_shooting",
               py::arg("sensitivities") = false, py::arg("section") = py::none(), py::arg("phase") = 0.0,
               py::arg("rotation") = std::vector<int>{}, py::arg("tolerance") = standard.tolerance,
               py::arg("maximum_iterations") = standard.maximum_iterations,
               py::arg("maximum_distance") = standard.maximum_distance, py::arg("nodes") = py::none(),
               "The periodic orbit near a guess.\n\n"
               "guess: points (p, n), one per period of the forcing, iteration, or crossing of the section; one state "
               "with\nperiod=p: the others are where the flow goes. Autonomous models without a section: one state, "
               "and the\nperiod in s.\n"
               "method: multiple_shooting, finite_difference or collocation; nodes of the latter two.\n"
               "Look at orbit.converged: numbers that did not come out are a status, not an exception.");
    bind_stability(module);
    bind_search(module);
}

}  // namespace orbid::python
