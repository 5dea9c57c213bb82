#include <algorithm>
#include <cctype>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/job_parts.hpp"
#include "orbits/records/unit.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

std::string extension(const std::filesystem::path& path) {
    std::string text = path.extension().string();
    for (char& c : text)
        c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

/// "theta", or { "column": "theta", "unit": "deg", "sign": -1, "offset": 3.14 }.
ColumnJob read_column(const ValueReader& value, Eigen::Index index, const models::Coordinate& entry) {
    ColumnJob column;
    column.coordinate = index;
    column.unit = entry.unit;
    if (value.is(JsonValue::Kind::string)) {
        column.column = *value.text();
        return column;
    }
    ObjectReader object(value);
    read_fields(object, describe::column_fields(), column);
    const auto unit = object.find("unit");
    if (unit && !orbits::unit_factor(column.unit, entry.unit))
        unit->report(fmt::format("unit \"{}\" cannot be turned into {}; known: {}", column.unit, entry.unit,
                                 orbits::units_like(entry.unit)));
    object.finish();
    return column;
}

/// "t", or { "column": "t", "unit": "ms" }.
void read_time(const ValueReader& value, std::string& column, std::string& time_unit) {
    if (value.is(JsonValue::Kind::string)) return value.read(column);
    ObjectReader object(value);
    object.read("column", column);
    if (const auto unit = object.read("unit", time_unit)) {
        if (!orbits::unit_factor(time_unit, "s"))
            unit->report(fmt::format("unit \"{}\" is no time; known: {}", time_unit, orbits::units_like("s")));
    }
    object.finish();
}

void read_columns(const ValueReader& value, const Job& job, FileJob& file) {
    for (const auto& [name, member] : value.members()) {
        if (name == "segment") {
            member.read(file.segment_column);
        } else if (name == "time") {
            read_time(member, file.time_column, file.time_unit);
        } else if (const auto coordinate = coordinate_named(name, member, job)) {
            const auto& entry = job.model.coordinate(*coordinate);
            file.columns.push_back(read_column(member, *coordinate, entry));
        }
    }
    std::sort(file.columns.begin(), file.columns.end(),
              [](const ColumnJob& a, const ColumnJob& b) { return a.coordinate < b.coordinate; });
    if (job.model.system && file.columns.empty() && value.is(JsonValue::Kind::object))
        value.report("must name the column of at least one coordinate of the model");
    if (file.sampling == Sampling::samples && file.time_column.empty())
        value.report("samples need the column of the time: \"time\": \"t\"");
}

/// What write_csv of orbid names its columns.
void take_default_columns(const Job& job, FileJob& file) {
    file.segment_column = "segment";
    const bool autonomous = job.model.is(models::Kind::autonomous);
    if (file.sampling == Sampling::samples || autonomous) file.time_column = "t";
    if (!job.model.system) return;
    for (const models::Coordinate& coordinate : job.model.system->coordinates()) {
        const auto index = static_cast<Eigen::Index>(file.columns.size());
        file.columns.push_back({index, std::string(coordinate.name), std::string(coordinate.unit), 1, 0.0});
    }
}

/// Inputs without a file stand in the table of the data.
void check_source(const ObjectReader& object, const DataJob& data) {
    if (data.simulation) {
        object.self().report("inputs of a simulation need a \"file\" with their record");
    } else if (!data.file->table) {
        object.self().report(
            "inputs come from a table in text; beside an HDF5 file name their own: \"file\": \"inputs.csv\"");
    }
}

}  // namespace

void read_file(ObjectReader& data, const ValueReader& path, const Job& job, FileJob& file) {
    const auto read = read_path(path, job);
    if (read) {
        file.path = *read;
        const std::string type = extension(*read);
        file.table = type == ".csv" || type == ".tsv" || type == ".txt";
        if (!file.table && type != ".h5" && type != ".hdf5")
            path.report(fmt::format("files end in .csv, .tsv, .txt, .h5 or .hdf5, not in \"{}\"", type));
    }
    file.sha256 = read_sha256(data);
    if (const auto kind = data.choose("kind", sampling_names, file.sampling)) {
        const bool map = job.model.is(models::Kind::map);
        if (map && file.sampling == Sampling::samples)
            kind->report(fmt::format("the model {} is a map: it has no samples in time; its iterates are a \"section\"",
                                     job.model.name));
    }
    const auto columns = data.find("columns");
    if (columns && !file.table) {
        columns->report("belongs to a table in text; an HDF5 file says itself what its columns are");
    } else if (columns) {
        read_columns(*columns, job, file);
    } else if (file.table) {
        take_default_columns(job, file);
    }
    if (const auto missing = data.find("missing")) file.nan_is_missing = missing->choice({"empty", "nan"}) == 1;
}

void read_inputs(ObjectReader& object, const Job& job, DataJob& data) {
    const auto value = object.find("inputs");
    const auto interpolation = object.find("interpolation");
    const auto inputs = job.model.system ? job.model.system->inputs() : std::span<const models::Coordinate>{};
    if (!value) {
        if (interpolation) interpolation->report("belongs to \"inputs\", which are missing");
        if (!inputs.empty() && object.valid())
            object.self().report(fmt::format("the model {} reads measured inputs ({}): \"inputs\" is missing",
                                             job.model.name, fmt::join(names_of(inputs), ", ")));
        return;
    }
    if (job.model.system && inputs.empty()) {
        value->report(fmt::format("the model {}{} reads no measured inputs", job.model.name,
                                  job.model.variant.empty() ? "" : ", variant " + job.model.variant + ","));
        return;
    }
    if (data.sampling() == Sampling::section) value->report_later("measured inputs of a section series");
    InputJob input;
    ObjectReader columns(*value);
    const auto file = columns.find("file");
    if (file) {
        input.file = read_path(*file, job);
        input.sha256 = read_sha256(columns);
        if (const auto time = columns.find("time")) read_time(*time, input.time_column, input.time_unit);
    }
    for (std::size_t i = 0; i < inputs.size(); ++i) {
        const auto column = columns.require(inputs[i].name, "the column of this input");
        if (column) input.columns.push_back(read_column(*column, static_cast<Eigen::Index>(i), inputs[i]));
    }
    if (!file) check_source(columns, data);
    // Without the model its inputs would be called unknown.
    if (job.model.system) columns.finish();
    if (interpolation) interpolation->choose(interpolation_names, input.interpolation);
    data.inputs = std::move(input);
}

}  // namespace orbid::apps
