#include <utility>

#include <pybind11/stl.h>

#include "orbits/invariants/correlation_dimension.hpp"
#include "orbits/invariants/cycle_expansion.hpp"
#include "orbits/invariants/lyapunov_spectrum.hpp"
#include "orbits/sections/delay_embedding.hpp"
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

using SharedSeries = std::shared_ptr<orbits::Series>;

py::dict lyapunov(const SharedSeries& series, const py::kwargs& keywords) {
    NamedArguments given("lyapunov_spectrum", keywords);
    orbits::LyapunovOptions options;
    given.take({{"order", options.order}, {"neighbours", options.neighbours}, {"steps", options.steps, 1}});
    given.take("symmetry_signs", options.symmetry_signs);
    given.finish();
    auto found = computed_interruptibly(options, [&] { return orbits::lyapunov_spectrum(*series, options); });
    return py::dict("exponents"_a = array(std::move(found.exponents)), "sds"_a = array(std::move(found.sds)),
                    "dimension"_a = found.dimension, "timed"_a = found.timed, "mean_time"_a = found.mean_time,
                    "divergence_rate"_a = found.divergence_rate, "divergence_sd"_a = found.divergence_sd,
                    "order"_a = found.order, "neighbours"_a = found.neighbours, "steps"_a = found.steps,
                    "lost"_a = found.lost, "prediction_error"_a = found.prediction_error,
                    "attenuation"_a = found.attenuation, "remarks"_a = found.remarks);
}

py::dict correlation(const SharedSeries& series, const py::kwargs& keywords) {
    NamedArguments given("correlation_dimension", keywords);
    orbits::CorrelationOptions options;
    given.take({{"theiler", options.theiler}, {"pairs", options.pairs, 1}, {"points", options.points, 1}});
    given.finish();
    const auto found = computed_interruptibly(options, [&] { return orbits::correlation_dimension(*series, options); });
    return py::dict(
        "dimension"_a = found.dimension, "sd"_a = found.sd, "takens"_a = found.takens, "takens_sd"_a = found.takens_sd,
        "radii"_a = py::make_tuple(found.smallest_radius, found.largest_radius), "entropy"_a = found.entropy,
        "entropy_sd"_a = found.entropy_sd, "timed"_a = found.timed, "remarks"_a = found.remarks);
}

py::dict term_dict(const orbits::CycleExpansionTerm& term) {
    return py::dict("period"_a = term.period, "cycles"_a = term.cycles, "conservation"_a = term.conservation,
                    "escape_rate"_a = term.escape_rate, "exponents"_a = array(Eigen::VectorXd(term.exponents)),
                    "metric_entropy"_a = term.metric_entropy, "topological_entropy"_a = term.topological_entropy,
                    "mean_time"_a = term.mean_time, "dimension"_a = term.dimension);
}

py::dict expansion(const std::vector<orbits::Cycle>& cycles, py::handle complete_to, bool continuous) {
    orbits::CycleExpansionOptions options;
    options.complete_to = static_cast<int>(whole_number(complete_to, "complete_to"));
    options.continuous = continuous;
    const auto found = computed_interruptibly([&] { return orbits::expand_cycles(cycles, options); });
    py::dict dict = term_dict(found.answer());
    dict["by_period"] = listed(found.by_period, term_dict);
    dict["timed"] = found.timed;
    dict["index_sums"] = found.index_sums;
    dict["escape_rate_sd"] = found.escape_rate_sd;
    dict["exponent_sds"] = array(Eigen::VectorXd(found.exponent_sds));
    return dict;
}

py::dict embedded(const SharedSeries& series, const py::kwargs& keywords) {
    NamedArguments given("embed", keywords);
    const std::vector<std::string> names = coordinate_names(*series);
    orbits::DelayEmbeddingOptions options;
    options.coordinate = index_of(given.text("coordinate", names.front()), names, "coordinate");
    given.take({{"delay", options.delay},
                {"dimension", options.dimension},
                {"largest_delay", options.largest_delay, 1},
                {"largest_dimension", options.largest_dimension, 1}});
    given.finish();
    auto found = computed_interruptibly([&] { return orbits::embed(*series, options); });
    return py::dict("series"_a = std::make_shared<orbits::Series>(std::move(found.series)), "delay"_a = found.delay,
                    "dimension"_a = found.dimension,
                    "mutual_information"_a = array(std::move(found.mutual_information)),
                    "false_neighbours"_a = array(std::move(found.false_neighbours)),
                    "minimum_found"_a = found.minimum_found, "unfolded"_a = found.unfolded);
}

}  // namespace

void bind_invariants(py::module_& module) {
    module.def(
        "lyapunov_spectrum", &lyapunov, py::arg("series").none(false),
        "Lyapunov exponents of a series from local maps, per section or, with times, per second: exponents, sds,\n"
        "dimension (Kaplan-Yorke), divergence_rate, remarks.\n\norder, neighbours (0: chosen), steps,\n"
        "symmetry_signs.");
    module.def("correlation_dimension", &correlation, py::arg("series").none(false),
               "Correlation dimension and entropy of a series: dimension, sd, takens, entropy, remarks.\n\n"
               "theiler, pairs, points.");
    module.def(
        "expand_cycles", &expansion, py::arg("cycles"), py::kw_only(), py::arg("complete_to"),
        py::arg("continuous") = true,
        "Invariants from all cycles up to the period `complete_to`: escape_rate, exponents, entropies, dimension,\n"
        "by_period, index_sums.");
    module.def("embed", &embedded, py::arg("series").none(false),
               "States rebuilt from one observable of samples: series, delay [samples], dimension.\n\n"
               "coordinate, delay, dimension (0: chosen by the data), largest_delay, largest_dimension.");
}

}  // namespace orbid::python
