#include <utility>

#include <pybind11/complex.h>
#include <pybind11/stl.h>

#include "orbits/cycles/cycle_search.hpp"
#include "orbits/cycles/model_guided_search.hpp"
#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

using orbits::Cycle;
using orbits::CycleSearch;
using Method = orbits::CycleSearchOptions::Method;

constexpr auto search_text = R"(Unstable periodic orbits of a section series: .cycles, .missing, .remarks and counts.

method   "automatic", "local_maps", "patch_map" or "closest_return"; periods ([1, 2, 3, 4, 5]); box (0.1), relative to
         Series.scale; neighbours, order (0: chosen by the data); minimum_recurrences (1); symmetry_signs, +1 or -1 per
         coordinate; reading_covariance, shape (n, n); partition, {"coordinate": "x", "boundaries": [0], "symbols": "LR"}.
Ctrl-C leaves the search: KeyboardInterrupt.)";

constexpr auto harvest_text =
    R"(Cycles of the series that an improved model leads to, as a dict: cycles, orbits, candidates, not_visited, rejected,
known, remarks.

parameters  of the system: dict, array of all, or None. known: the cycles of find_cycles(), mirror partners included.
covariance  of the free parameters, shape (f, f), and free, their names: how far off they may be; sensor, phase, section as
            in simulate(); maximum_orbits (400), search_points (100000); and the options of find_cycles().)";

std::shared_ptr<CycleSearch> find_cycles(const std::shared_ptr<orbits::Series>& series, const py::kwargs& keywords) {
    NamedArguments given("find_cycles", keywords);
    orbits::CycleSearchOptions options = search_options(given, coordinate_names(*series));
    given.finish();
    return std::make_shared<CycleSearch>(
        computed_interruptibly(options, [&] { return orbits::find_cycles(*series, options); }));
}

py::dict harvest(const std::shared_ptr<orbits::Series>& series, const py::object& system, const py::object& parameters,
                 const std::vector<Cycle>& known, const py::kwargs& keywords) {
    const auto model = system_of(system);
    const Eigen::VectorXd theta = parameter_values(*model, parameters);
    NamedArguments given("harvest", keywords);
    orbits::ModelGuidedSearchOptions options;
    options.search = search_options(given, coordinate_names(*series));
    options.sensor = sensor(given.find("sensor"), *model);
    given.take("phase", options.phase);
    if (const py::object crossed = given.find_value("section")) options.section = plane(*model, crossed);
    given.take("covariance", options.covariance);
    for (const std::string& name : given.texts("free"))
        options.free.push_back(index_of(name, parameter_names(*model), "parameter"));
    given.take({{"maximum_orbits", options.maximum_orbits, 1}, {"search_points", options.search_points, 100}});
    given.finish();
    const auto found = computed_interruptibly(options.search, [&] {
        const auto stoppable = model->with_stop(options.search.interrupted);
        return orbits::model_guided_search(*series, *stoppable, theta, known, options);
    });
    return py::dict("cycles"_a = found.cycles, "orbits"_a = found.orbits, "candidates"_a = found.candidates,
                    "not_visited"_a = found.not_visited, "rejected"_a = found.rejected, "known"_a = found.known,
                    "remarks"_a = found.remarks);
}

/// A cycle that was measured elsewhere.
Cycle make_cycle(const py::object& points, const py::kwargs& keywords) {
    NamedArguments given("Cycle", keywords);
    const Doubles written = doubles(points, "points");
    if (written.ndim() != 2 || written.size() == 0)
        throw py::value_error("points: shape " + std::string(py::str(written.attr("shape"))) +
                              ", needs (period, coordinates)");
    const Doubles checked = records(written, "points", written.shape(1));
    Cycle cycle;
    cycle.points = matrix(checked);
    cycle.period = static_cast<int>(cycle.points.cols());
    given.take("covariance", cycle.covariance);
    const Eigen::Index size = cycle.points.size();
    if (cycle.covariance.size() > 0 && (cycle.covariance.rows() != size || cycle.covariance.cols() != size))
        throw py::value_error("Cycle: covariance: needs shape (" + std::to_string(size) + ", " + std::to_string(size) +
                              ")");
    given.take({{"ln_multiplier", cycle.ln_multiplier},
                {"ln_multiplier_covariance", cycle.ln_multiplier_covariance},
                {"time", cycle.time},
                {"time_sd", cycle.time_sd},
                {"time_covariance", cycle.time_covariance}});
    if (cycle.time_covariance.size() > 0 && cycle.time_covariance.size() != size)
        throw py::value_error("Cycle: time_covariance: needs shape (" + std::to_string(size) + ",)");
    if (const py::object multipliers = given.find_value("multipliers")) try {
            cycle.multipliers = multipliers.cast<std::vector<std::complex<double>>>();
        } catch (const py::cast_error&) {
            throw py::type_error("Cycle: multipliers: needs a list of complex numbers");
        }
    given.finish();
    return cycle;
}

}  // namespace

orbits::CycleSearchOptions search_options(NamedArguments& given, const std::vector<std::string>& names) {
    orbits::CycleSearchOptions options;
    options.method = given.word<Method>("method",
                                        {{"automatic", Method::automatic},
                                         {"local_maps", Method::local_maps},
                                         {"patch_map", Method::spline_map},
                                         {"closest_return", Method::closest_return}},
                                        Method::automatic);
    given.take({{"periods", options.periods, 1},
                {"box", options.box},
                {"neighbours", options.neighbours},
                {"order", options.order},
                {"minimum_recurrences", options.minimum_recurrences, 1}});
    given.take({{"symmetry_signs", options.symmetry_signs}, {"reading_covariance", options.reading_covariance}});
    if (const py::object partition = given.find_value("partition")) {
        NamedArguments parts("partition", partition);
        orbits::Partition cut;
        cut.coordinate = index_of(parts.text("coordinate", names.front()), names, "coordinate");
        parts.take({{"boundaries", cut.boundaries}, {"symbols", cut.symbols}});
        parts.finish();
        options.partition = std::move(cut);
    }
    return options;
}

void bind_cycles(py::module_& module) {
    py::class_<Cycle>(module, "Cycle",
                      "An unstable periodic orbit found in a series.\n\n"
                      "points, shape (period, n); covariance of all of them, shape (period n, period n), coordinate\n"
                      "fastest; multipliers, largest modulus first, and ln |multiplier| with covariance; time [s].")
        .def(py::init(&make_cycle), py::arg("points"))
        .def_readonly("period", &Cycle::period, "prime period, in sections")
        .def_readonly("rotation", &Cycle::rotation, "turns per cycle, one per angle; empty: the data do not tell")
        .def_property_readonly("points", memory_of(&Cycle::points))
        .def_property_readonly("covariance", written_memory_of(&Cycle::covariance))
        .def_property_readonly("multipliers", memory_of(&Cycle::multipliers))
        .def_property_readonly("ln_multiplier", memory_of(&Cycle::ln_multiplier))
        .def_property_readonly("ln_multiplier_covariance", written_memory_of(&Cycle::ln_multiplier_covariance))
        .def_property_readonly(
            "common_errors", written_memory_of(&Cycle::common),
            "G, shape (period n + n, columns), or one row more for the time: of the covariance G_c G_d' of this\n"
            "cycle's points and ln |multipliers| with those of others in its list; empty: none are known")
        .def_readonly("time", &Cycle::time)
        .def_readonly("time_sd", &Cycle::time_sd)
        .def_property_readonly("time_covariance", memory_of(&Cycle::time_covariance),
                               "of the time with the points, shape (period n,); empty: taken as 0")
        .def_readonly("code", &Cycle::code, "one symbol per point; empty without a partition")
        .def_readonly("recurrences", &Cycle::recurrences, "points of the series that led here")
        .def_readonly("mirror", &Cycle::mirror, "index of the mirror partner in the list, or None")
        .def_readonly("quality", &Cycle::quality, "remarks in words; empty: nothing to remark")
        .def("__repr__", [](const Cycle& one) { return "<Cycle of period " + std::to_string(one.period) + ">"; });
    py::class_<CycleSearch, std::shared_ptr<CycleSearch>>(module, "CycleSearch", "What a search for cycles found.")
        .def_readonly("cycles", &CycleSearch::cycles, "by period, then by descending recurrences")
        .def_readonly("missing", &CycleSearch::missing, "periods of which no cycle was found")
        .def_readonly("candidates", &CycleSearch::candidates)
        .def_readonly("rejected", &CycleSearch::rejected)
        .def_readonly("patch_map", &CycleSearch::spline_map)
        .def_property_readonly("reading_covariance", written_memory_of(&CycleSearch::reading_covariance),
                               "of the errors of one reading, shape (n, n); empty: not estimated")
        .def_readonly("remarks", &CycleSearch::remarks);
    module.def("find_cycles", &find_cycles, py::arg("series").none(false), search_text);
    module.def("harvest", &harvest, py::arg("series").none(false), py::arg("system"), py::arg("parameters"),
               py::arg("known"), harvest_text);
}

}  // namespace orbid::python
