#include "python/orbits/series_bindings.hpp"

#include <algorithm>
#include <utility>

#include <pybind11/stl.h>

#include "python/conversion/arguments.hpp"
#include "python/conversion/arrays.hpp"
#include "python/conversion/bindings.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/conversion/properties.hpp"

namespace orbid::python {

namespace py = pybind11;
using namespace pybind11::literals;

namespace {

using orbits::Segment;
using orbits::Series;

/// Keeps an array alive, from whatever thread the last look at it goes.
std::shared_ptr<const void> keeper(py::object array) {
    return {array.release().ptr(), [](const void* kept) {
                const py::gil_scoped_acquire lock;
                Py_DECREF(static_cast<PyObject*>(const_cast<void*>(kept)));
            }};
}

/// An array (m, n) in C order looked at as the library's readings (n, m): nothing is copied.
orbits::Readings readings(py::handle values, py::ssize_t columns, const std::string& place) {
    Doubles array = doubles(values, place.c_str());
    // The only coordinate's readings one after the other.
    if (columns == 1 && array.ndim() == 1) array = Doubles(array.reshape({array.size(), py::ssize_t{1}}));
    array = records(array, place.c_str(), columns, true);
    return orbits::Readings::borrowed(array.data(), array.shape(1), array.shape(0), keeper(array));
}

/// A list with one item for each segment; one array stands for a list of one. `rank` of a segment's array: a list of
/// arrays with fewer dimensions is a list of records, as np.asarray has it.
std::vector<py::object> per_segment(const py::object& value, py::ssize_t rank) {
    if (!value || value.is_none()) return {};
    const bool several =
        (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) && py::len(value) > 0 &&
        std::any_of(value.begin(), value.end(), [&](py::handle item) {
            return py::isinstance<py::array>(item) && py::reinterpret_borrow<py::array>(item).ndim() >= rank;
        });
    if (!several) return {value};
    std::vector<py::object> list;
    for (const py::handle item : value)
        list.push_back(py::reinterpret_borrow<py::object>(item));
    return list;
}

void check_count(std::size_t count, std::size_t segments, const char* name) {
    if (count != 0 && count != segments)
        throw py::value_error(std::string(name) + ": " + std::to_string(count) + " given, needs one for each of " +
                              std::to_string(segments) + " segments");
}

std::shared_ptr<Series> make_series(const py::object& values, const py::object& coordinates,
                                    const py::kwargs& keywords) {
    NamedArguments given("Series", keywords);
    auto series = std::make_shared<Series>();
    series->coordinates = series_coordinates(coordinates);
    const std::vector<py::object> arrays = per_segment(values, 2);
    if (arrays.empty()) throw py::type_error("values: None, needs an array (records, coordinates) or a list of them");
    const std::vector<py::object> times = per_segment(given.find_value("times"), 1);
    const std::vector<py::object> deviations = per_segment(given.find_value("deviations"), 2);
    const std::vector<std::string> labels = given.texts("labels");
    check_count(times.size(), arrays.size(), "times");
    check_count(deviations.size(), arrays.size(), "deviations");
    check_count(labels.size(), arrays.size(), "labels");
    series->sampling = sampling(given, !times.empty());
    if (series->sampling == Series::Sampling::samples && times.empty())
        throw py::value_error("Series: samples need times");
    given.take({{"phase", series->phase}, {"origin", series->origin}});
    given.finish();
    for (std::size_t s = 0; s < arrays.size(); ++s) {
        const std::string number = arrays.size() > 1 ? "[" + std::to_string(s) + "]" : "";
        Segment segment;
        segment.label = labels.empty() ? std::to_string(s) : labels[s];
        segment.values = readings(arrays[s], series->dimension(), "values" + number);
        const py::ssize_t count = segment.values.cols();
        if (count == 0) throw py::value_error("values" + number + ": there is no record");
        if (!times.empty()) {
            const std::string place = "times" + number;
            segment.times = vector(finite_vector(times[s], place.c_str(), count));
            for (Eigen::Index k = 1; k < count; ++k)
                if (!(segment.times[k] > segment.times[k - 1]))
                    throw py::value_error(place + "[" + std::to_string(k) + "]: times must ascend");
        }
        if (!deviations.empty()) {
            const std::string place = "deviations" + number;
            const orbits::Readings sds = readings(deviations[s], series->dimension(), place);
            if (sds.cols() != count)
                throw py::value_error(place + ": " + std::to_string(sds.cols()) + " records, needs " +
                                      std::to_string(count));
            segment.deviations = Eigen::Map<const Eigen::MatrixXd>(sds.data(), sds.rows(), sds.cols());
            if (!(segment.deviations.array() > 0.0 || segment.deviations.array().isNaN()).all())
                throw py::value_error(place + ": sds must be > 0, or nan where none is known");
        }
        series->segments.push_back(std::move(segment));
    }
    return series;
}

/// One piece of a record, which it keeps alive.
struct SegmentView {
    std::shared_ptr<Series> series;
    std::size_t index = 0;
    [[nodiscard]] const Segment& segment() const { return series->segments[index]; }
};

/// The memory of readings (n, m) as a read-only array (m, n) that keeps their owner alive.
py::array values_array(const py::object& self) {
    const orbits::Readings& values = self.cast<const SegmentView&>().segment().values;
    return read_only(py::array_t<double>({values.cols(), values.rows()}, values.data(), self));
}

py::list segments(const std::shared_ptr<Series>& series) {
    py::list list;
    for (std::size_t s = 0; s < series->segments.size(); ++s)
        list.append(SegmentView{series, s});
    return list;
}

py::list coordinate_list(const Series& series) {
    return listed(series.coordinates, [](const orbits::SeriesCoordinate& one) {
        return py::dict("name"_a = one.name, "unit"_a = one.unit, "angle"_a = one.angle);
    });
}

constexpr auto series_text =
    R"(A measured or simulated record in segments, shape (records, coordinates) each; nan is a missing reading.

values       array, or a list of arrays, one for each segment; shape (records,) will do for one coordinate. float64 in C order is looked at in place, without a copy,
             and kept alive: what is written into it later changes the record. Others are copied; integers are taken.
coordinates  a System, or a list of names or of dicts with name, unit, angle.
times        [s] of each record, ascending; sampling "samples" (with times) or "section"; deviations: known sds like
             values; phase [rad] of the section, or of the forcing at time 0; labels of the segments; origin.)";

}  // namespace

std::shared_ptr<const models::System> system_of(py::handle system) {
    if (!py::isinstance<models::System>(system))
        throw py::type_error("system: " + std::string(py::repr(system)) + " is no System; see orbid.model()");
    return system.cast<std::shared_ptr<models::System>>();
}

std::vector<std::string> coordinate_names(const Series& series) {
    std::vector<std::string> names;
    for (const orbits::SeriesCoordinate& coordinate : series.coordinates)
        names.push_back(coordinate.name);
    return names;
}

std::vector<orbits::SeriesCoordinate> series_coordinates(py::handle coordinates) {
    std::vector<orbits::SeriesCoordinate> result;
    if (py::isinstance<models::System>(coordinates)) {
        for (const models::Coordinate& one : system_of(coordinates)->coordinates())
            result.push_back({std::string(one.name), std::string(one.unit), one.angle});
        return result;
    }
    if (!is_list(coordinates))
        throw py::type_error("coordinates: needs a System, or a list of names or of dicts with name, unit, angle");
    for (const py::handle item : coordinates) {
        if (py::isinstance<py::str>(item)) {
            result.push_back({item.cast<std::string>(), "", false});
        } else {
            NamedArguments given("coordinates[" + std::to_string(result.size()) + "]", item);
            const std::string name = given.text("name", "");
            const std::string unit = given.text("unit", "");
            result.push_back({name, unit, given.flag("angle", false)});
            given.finish();
        }
        if (result.back().name.empty()) throw py::value_error("coordinates: one has no name");
        for (std::size_t i = 0; i + 1 < result.size(); ++i)
            if (result[i].name == result.back().name)
                throw py::value_error("coordinates: '" + result[i].name + "' is named twice");
    }
    if (result.empty()) throw py::value_error("coordinates: there is none");
    return result;
}

Series::Sampling sampling(NamedArguments& given, bool timed) {
    using Sampling = Series::Sampling;
    return given.word<Sampling>("sampling", {{"section", Sampling::section}, {"samples", Sampling::samples}},
                                timed ? Sampling::samples : Sampling::section);
}

models::FlowOptions flow_options(NamedArguments& given, models::FlowOptions usual) {
    given.take({{"rtol", usual.relative_tolerance},
                {"atol", usual.absolute_tolerance},
                {"maximum_steps", usual.maximum_steps, 1}});
    return usual;
}

void bind_orbits(py::module_& module) {
    bind_series(module);
    bind_series_files(module);
    bind_simulation(module);
    bind_cycles(module);
    bind_invariants(module);
}

void bind_series(py::module_& module) {
    py::class_<SegmentView>(module, "Segment", "One uninterrupted piece of a Series.")
        .def_property_readonly("label", [](const SegmentView& one) { return one.segment().label; })
        .def_property_readonly("values", &values_array,
                               "shape (records, coordinates): the series' own memory, read-only; nan is missing")
        .def_property_readonly(
            "times", [](const py::object& self) { return view(self.cast<const SegmentView&>().segment().times, self); },
            "shape (records,) [s]; empty without times")
        .def_property_readonly(
            "deviations",
            [](const py::object& self) { return view(self.cast<const SegmentView&>().segment().deviations, self); },
            "known sds like values; empty where none is known")
        .def("__len__", [](const SegmentView& one) { return one.segment().values.cols(); });
    py::class_<Series, std::shared_ptr<Series>>(module, "Series", series_text)
        .def(py::init(&make_series), py::arg("values"), py::arg("coordinates"))
        .def_property_readonly(
            "sampling",
            [](const Series& one) { return one.sampling == Series::Sampling::section ? "section" : "samples"; })
        .def_property_readonly("coordinates", &coordinate_list)
        .def_property_readonly("segments", &segments)
        .def_readonly("phase", &Series::phase, "[rad] of the section, or of the forcing at time 0")
        .def_readonly("origin", &Series::origin)
        .def_property_readonly("timed", &Series::timed)
        .def_property_readonly(
            "scale", [](const Series& one) { return array(unlocked([&] { return one.scale(); })); },
            "size of each coordinate's range, shape (coordinates,): 2 pi for angles")
        .def("__len__", &Series::size, "records of all segments")
        .def("__repr__", [](const Series& one) {
            return "<Series of " + std::to_string(one.size()) + " records in " + std::to_string(one.segments.size()) +
                   (one.segments.size() == 1 ? " segment>" : " segments>");
        });
}

}  // namespace orbid::python
