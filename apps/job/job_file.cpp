#include <algorithm>
#include <cctype>
#include <cmath>

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

void read_columns(const ValueReader& value, const Job& job, FileJob& file) {
    for (const auto& [name, member] : value.members()) {
        if (name == "segment") {
            file.segment_column = member.text().value_or("");
        } else if (name == "time") {
            read_time(member, file.time_column, file.time_unit);
        } else if (const auto coordinate = coordinate_named(name, member, job)) {
            const auto& entry = job.model.system->coordinates()[static_cast<std::size_t>(*coordinate)];
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
    const bool autonomous = job.model.system && job.model.system->kind() == models::Kind::autonomous;
    if (file.sampling == Sampling::samples || autonomous) file.time_column = "t";
    if (!job.model.system) return;
    for (const models::Coordinate& coordinate : job.model.system->coordinates()) {
        const auto index = static_cast<Eigen::Index>(file.columns.size());
        file.columns.push_back({index, std::string(coordinate.name), std::string(coordinate.unit), 1, 0.0});
    }
}

}  // namespace

ColumnJob read_column(const ValueReader& value, Eigen::Index index, const models::Coordinate& entry) {
    ColumnJob column;
    column.coordinate = index;
    column.unit = entry.unit;
    if (value.is(JsonValue::Kind::string)) {
        column.column = *value.text();
        return column;
    }
    ObjectReader object(value);
    if (const auto name = object.find("column")) column.column = name->text().value_or("");
    if (const auto unit = object.find("unit")) {
        column.unit = unit->text().value_or(column.unit);
        if (!orbits::unit_factor(column.unit, entry.unit))
            unit->report(fmt::format("unit \"{}\" cannot be turned into {}; known: {}", column.unit, entry.unit,
                                     orbits::units_like(entry.unit)));
    }
    if (const auto sign = object.find("sign")) column.sign = sign->number() == -1.0 ? -1 : 1;
    if (const auto offset = object.find("offset")) column.offset = offset->number().value_or(0.0);
    object.finish();
    return column;
}

void read_time(const ValueReader& value, std::string& column, std::string& time_unit) {
    if (value.is(JsonValue::Kind::string)) {
        column = *value.text();
        return;
    }
    ObjectReader object(value);
    if (const auto name = object.find("column")) column = name->text().value_or("");
    if (const auto unit = object.find("unit")) {
        time_unit = unit->text().value_or("s");
        if (!orbits::unit_factor(time_unit, "s"))
            unit->report(fmt::format("unit \"{}\" is no time; known: {}", time_unit, orbits::units_like("s")));
    }
    object.finish();
}

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
    if (const auto kind = data.find("kind")) {
        if (kind->choice({"section", "samples"}) == 1) file.sampling = Sampling::samples;
        const bool map = job.model.system && job.model.system->kind() == models::Kind::map;
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

}  // namespace orbid::apps
