#include "orbits/records/series_file.hpp"

#include <filesystem>
#include <utility>

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "python/conversion/named_arguments.hpp"
#include "python/conversion/python_interruption.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

using orbits::Series;

/// Coordinates as columns of a table: {"phi": "angle"} or {"phi": {"column": .., "unit": .., ...}}.
std::vector<orbits::CoordinateColumn> columns(py::handle description, const py::object& known) {
    if (!is_mapping(description))
        throw py::type_error("columns: needs a dict from coordinates to columns, or to dicts with \"column\"");
    std::vector<orbits::SeriesCoordinate> table;
    if (known && !known.is_none()) table = series_coordinates(known);
    std::vector<orbits::CoordinateColumn> result;
    for (const auto& [key, value] : mapping(description, "columns")) {
        const std::string name = py::str(key);
        orbits::CoordinateColumn column;
        column.coordinate.name = name;
        for (const orbits::SeriesCoordinate& one : table)
            if (one.name == name) column.coordinate = one;
        if (py::isinstance<py::str>(value)) {
            column.column = value.cast<std::string>();
        } else {
            NamedArguments given("columns: " + name, value);
            column.column = given.text("column", name);
            given.take({{"unit", column.unit},
                        {"sign", column.sign},
                        {"offset", column.offset},
                        {"sd", column.sd},
                        {"factor", column.factor}});
            given.finish();
        }
        result.push_back(std::move(column));
    }
    return result;
}

/// "window", "rows", "every".
orbits::RecordPart record_part(NamedArguments& given) {
    orbits::RecordPart part;
    const auto need_two = [](Eigen::Index count, const char* name) {
        if (count != 2) throw py::value_error(std::string("read_csv: ") + name + ": needs (first, last)");
    };
    if (given.has("window")) {
        const Eigen::VectorXd ends = given.vector("window");
        need_two(ends.size(), "window");
        part.begin = ends[0];
        part.end = ends[1];
    }
    if (given.has("rows")) {
        const std::vector<long long> ends = given.integers("rows", 1);
        need_two(static_cast<Eigen::Index>(ends.size()), "rows");
        part.first_row = static_cast<std::size_t>(ends[0]);
        part.last_row = static_cast<std::size_t>(ends[1]);
    }
    given.take({{"every", part.every, 1}});
    return part;
}

std::shared_ptr<Series> read_csv(const std::filesystem::path& file, const py::object& described,
                                 const py::object& coordinates, const py::kwargs& keywords) {
    NamedArguments given("read_csv", keywords);
    orbits::TableLayout layout;
    layout.coordinates = columns(described, coordinates);
    given.take({{"segment", layout.segment}, {"time", layout.time}});
    given.take({{"step", layout.step}});
    layout.sampling = sampling(given, !layout.time.empty() || layout.step > 0.0);
    layout.part = record_part(given);
    given.take({{"time_unit", layout.time_unit},
                {"nan_is_missing", layout.nan_is_missing},
                {"phase", layout.phase},
                {"minimum_points", layout.minimum_points, 1},
                {"time_tolerance", layout.time_tolerance},
                {"equidistant", layout.equidistant},
                {"complete", layout.complete}});
    given.finish();
    return std::make_shared<Series>(computed_interruptibly(layout, [&] { return orbits::read_csv(file, layout); }));
}

template <auto write>
void written(const std::filesystem::path& file, const std::shared_ptr<Series>& series) {
    const py::gil_scoped_release unlocked;
    // A stop would leave half a file.
    write(file, *series, {});
}

}  // namespace

void bind_series_files(py::module_& module) {
    module.def(
        "read_csv", &read_csv, py::arg("file"), py::arg("columns"), py::arg("coordinates") = py::none(),
        "A Series from a table in text with a header line.\n\n"
        "columns: dict from coordinates to columns, or to dicts with column, unit, sign, offset, sd: value =\n"
        "sign * (column * unit - offset). coordinates: a System or a list as for Series, for units and angles.\n"
        "segment, time: columns; time_unit (\"s\"), step [s] of samples without times, sampling,\n"
        "nan_is_missing, phase, minimum_points. window (first, last) [s], rows (first, last) from 1, every: the\n"
        "part that is read.\n"
        "time_tolerance (0.05), equidistant (True), complete (False). DataError names file, line and column.");
    module.def(
        "read_hdf5",
        [](const std::filesystem::path& file, std::size_t minimum_points) {
            struct {
                std::function<bool()> interrupted;
            } asked;
            return std::make_shared<Series>(computed_interruptibly(
                asked, [&] { return orbits::read_hdf5(file, minimum_points, asked.interrupted); }));
        },
        py::arg("file"), py::kw_only(), py::arg("minimum_points") = 1,
        "The Series that write_hdf5() wrote, to the bit.");
    module.def("write_csv", &written<orbits::write_csv>, py::arg("file"), py::arg("series").none(false),
               "One column per coordinate, \"segment\" and, with times, \"t\"; known sds are not stored.");
    module.def("write_hdf5", &written<orbits::write_hdf5>, py::arg("file"), py::arg("series").none(false),
               "Format \"orbid-series/1\"; equal series give equal bytes.");
}

}  // namespace orbid::python
