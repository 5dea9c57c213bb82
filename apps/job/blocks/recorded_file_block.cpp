#include <algorithm>
#include <cctype>

#include "apps/documents/file_pattern.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"
#include "orbits/records/unit.hpp"

namespace orbid::apps::describe {

using Json = nlohmann::ordered_json;
using Sampling = orbits::Series::Sampling;

namespace {

/// Its unit is the coordinate's until it is read.
void read_unit(const ValueReader& value, const Job&, ColumnJob& column) {
    const std::string own = column.unit;
    value.read(column.unit);
    if (!orbits::unit_factor(column.unit, own))
        value.report(
            fmt::format("unit \"{}\" cannot be turned into {}; known: {}", column.unit, own, orbits::units_like(own)));
}

}  // namespace

const FieldTable<ColumnJob>& column_fields() {
    static const FieldTable<ColumnJob> table{
        open_field(key("column", header(), "Its header in the file.").required_always(), &ColumnJob::column),
        {key("unit", text(), "Of the column; the coordinate's own unless given."), read_unit,
         [](const ColumnJob& column, const Writing&) -> Json { return column.unit; }},
        field(key("factor", above(0.0), "Of the instrument: 0.18 with \"unit\": \"m\" for 0.18 m per volt."),
              &ColumnJob::factor)
            .written_if([](const ColumnJob& column) { return column.factor != 1.0; }),
        field(key("sign", one_of({1.0, -1.0}), "Model value = sign * (column * factor * unit - offset)."),
              &ColumnJob::sign),
        field(key("offset", number(), "In the coordinate's unit."), &ColumnJob::offset)};
    return table;
}

ValueSchema column() {
    return named("column", header() | object(keys_of(column_fields())));
}

ColumnJob read_column(const ValueReader& value, Eigen::Index index, std::string_view unit) {
    ColumnJob column;
    column.coordinate = index;
    column.unit = unit;
    read_short_or_object(value, "column", column_fields(), column);
    return column;
}

namespace {

std::string extension(const std::filesystem::path& path) {
    std::string text = path.extension().string();
    for (char& c : text)
        c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

template <class Table>
const FieldTable<Table>& time_fields() {
    static const FieldTable<Table> table{
        open_field(key("column", header(), "Its header in the file.").required_always(), &Table::time_column),
        field(key("unit", text(), "Of the time."), &Table::time_unit)
            .with_rule([](const ValueReader& value, const Job&, Table& read) {
                if (!orbits::unit_factor(read.time_unit, "s"))
                    value.report(
                        fmt::format("unit \"{}\" is no time; known: {}", read.time_unit, orbits::units_like("s")));
            })};
    return table;
}

/// The column of the time in a table: "t", or { "column": "t", "unit": "ms" }.
template <class Table>
Field<Table> time_field(KeySchema described) {
    described.value = named("time_column", header() | object(keys_of(time_fields<Table>())));
    return {std::move(described),
            [](const ValueReader& value, const Job&, Table& table) {
                read_short_or_object(value, "column", time_fields<Table>(), table);
            },
            [](const Table& table, const Writing&) {
                return table.time_column.empty() ? left_out() : fields_document(table, time_fields<Table>());
            }};
}

/// Of "columns", beside the coordinates.
const FieldTable<FileJob>& table_fields() {
    static const FieldTable<FileJob> table{
        text_field(key("segment", header(), "The column that numbers or names the segments."),
                   &FileJob::segment_column),
        time_field<FileJob>(key("time", {}, "The column of the time; samples need one."))};
    return table;
}

void read_columns(const ValueReader& value, const Job& job, FileJob& file) {
    if (!file.table)
        return value.report(
            "belongs to a table (text, Matlab); an HDF5 file of orbid says itself what its columns are");
    for (const auto& [name, member] : value.members()) {
        if (const auto* own = find_field(table_fields(), name)) {
            own->read(member, job, file);
        } else if (const auto coordinate = coordinate_named(name, member, job)) {
            file.columns.push_back(read_column(member, *coordinate, job.model.coordinate(*coordinate).unit));
        }
    }
    std::sort(file.columns.begin(), file.columns.end(),
              [](const ColumnJob& a, const ColumnJob& b) { return a.coordinate < b.coordinate; });
    if (job.model.system && file.columns.empty() && value.is(JsonValue::Kind::object))
        value.report("must name the column of at least one coordinate of the model");
    if (file.sampling == Sampling::samples && file.time_column.empty() && file.step == 0.0)
        value.report("samples need the column of the time: \"time\": \"t\"; or their \"step\" beside \"file\"");
    if (file.step > 0.0 && !file.time_column.empty())
        value.report("has a column of the time beside \"step\": leave one of them out");
}

Json columns_of_table(const FileJob& file, const Writing& at) {
    Json columns = fields_document(file, table_fields(), at);
    for (const ColumnJob& column : file.columns)
        columns[coordinate_name(at.job, column.coordinate)] = fields_document(column, column_fields());
    return columns;
}

void check_sampling(const ValueReader& value, const Job& job, FileJob& file) {
    if (job.model.is(models::Kind::map) && file.sampling == Sampling::samples)
        value.report(fmt::format("the model {} is a map: it has no samples in time; its iterates are a \"section\"",
                                 job.model.name));
}

void read_step(const ValueReader& value, const Job&, FileJob& file) {
    value.read(file.step);
    if (file.table && file.sampling == Sampling::samples) return;
    value.report("belongs to samples in a table");
    file.step = 0.0;
}

/// What else is said of a file.
const FieldTable<FileJob>& recorded_file_fields() {
    static const FieldTable<FileJob> table{
        text_field(key("sha256", sha256(), "Of the file: refused if it has changed.").with_either("file", "files"),
                   &FileJob::sha256),
        choice_field(key("kind", {}, "One reading per period of the forcing, or samples in time.")
                         .with_either("file", "files")
                         .required_always(),
                     sampling_names, &FileJob::sampling)
            .with_rule(check_sampling),
        Field<FileJob>{
            key("step", above(0.0), "Interval of samples in a table without a column of the time.")
                .in("s")
                .with_either("file", "files"),
            read_step,
            [](const FileJob& file, const Writing&) { return file.step > 0.0 ? Json(file.step) : left_out(); }},
        Field<FileJob>{key("columns", entries(column(), "a coordinate of the model", keys_of(table_fields())),
                           "Which column of a table is what; unless given those that orbid writes.")
                           .with_either("file", "files"),
                       read_columns, columns_of_table}
            .written_if([](const FileJob& file) { return file.table; }),
        word_field(
            key("missing", {}, "What marks a missing sample; \"nan\": that word too.").with_either("file", "files"),
            {{false, "empty"}, {true, "nan"}}, &FileJob::nan_is_missing),
        stream_field()};
    return table;
}

void take_type(const ValueReader& value, FileJob& file) {
    const std::string type = extension(file.paths.front());
    file.table = type == ".csv" || type == ".tsv" || type == ".txt" || type == ".mat";
    if (!file.table && type != ".h5" && type != ".hdf5")
        value.report(fmt::format("files end in .csv, .tsv, .txt, .mat, .h5 or .hdf5, not in \"{}\"", type));
    for (const auto& path : file.paths)
        if (extension(path) != type)
            value.report_data(
                fmt::format("matches files of several types: {} and {}", file.paths.front().string(), path.string()));
}

void read_recorded_file(const ValueReader& value, const Job& job, DataJob& data) {
    data.simulation.reset();
    FileJob& file = data.file.emplace();
    const auto path = read_path(value, job);
    file.paths = {path.value_or("")};
    if (path) take_type(value, file);
}

void read_recorded_files(const ValueReader& value, const Job& job, DataJob& data) {
    data.simulation.reset();
    FileJob& file = data.file.emplace();
    file.paths = {""};
    const auto text = value.text();
    if (!text) return;
    file.pattern = (job.source.parent_path() / *text).lexically_normal().string();
    const auto paths = matching_files(file.pattern);
    if (paths.empty()) return value.report_data(fmt::format("no file matches \"{}\"", file.pattern));
    file.paths = paths;
    take_type(value, file);
}

/// Of "inputs", beside the inputs themselves.
const FieldTable<InputJob>& input_file_fields() {
    static const FieldTable<InputJob> table{
        file_field(key("file", file_name(), "A table of their own; left out, they stand in the table of the data."),
                   &InputJob::file),
        text_field(key("sha256", sha256(), "Of that file: refused if it has changed.").with("file"), &InputJob::sha256),
        time_field<InputJob>(key("time", {}, "Its column of the time.").with("file").by_default("t"))};
    return table;
}

/// Inputs without a file stand in the table of the data.
void check_input_source(const ValueReader& value, const DataJob& data) {
    if (data.simulation) {
        value.report("inputs of a simulation need a \"file\" with their record");
    } else if (!data.file->table) {
        value.report("inputs come from a table; beside an HDF5 file name their own: \"file\": \"inputs.csv\"");
    }
}

void read_inputs(const ValueReader& value, const Job& job, DataJob& data) {
    InputJob& input = data.inputs.emplace();
    const auto inputs = job.model.system ? job.model.system->inputs() : std::span<const models::Coordinate>{};
    if (job.model.system && inputs.empty())
        return value.report(fmt::format("the model {}{} reads no measured inputs", job.model.name,
                                        job.model.variant.empty() ? "" : ", variant " + job.model.variant + ","));
    if (data.sampling() == Sampling::section) value.report_later("measured inputs of a section series");
    ObjectReader columns(value);
    read_fields(columns, input_file_fields(), input, job);
    for (std::size_t i = 0; i < inputs.size(); ++i) {
        const auto column = columns.require(inputs[i].name, "the column of this input");
        if (column) input.columns.push_back(read_column(*column, static_cast<Eigen::Index>(i), inputs[i].unit));
    }
    if (!columns.find("file")) check_input_source(value, data);
    // Without the model its inputs would be called unknown.
    if (job.model.system) columns.finish();
}

/// A number, or a parameter of the model that its formulas need not contain.
void read_delay(const ValueReader& value, const Job& job, InputJob& input) {
    if (value.is(JsonValue::Kind::number)) return value.read(input.delay);
    if (const auto name = value.text()) input.delay_parameter = parameter_named(*name, value, job);
}

Json inputs_document(const DataJob& data, const Writing& at) {
    if (!data.inputs) return left_out();
    Json inputs = fields_document(*data.inputs, input_file_fields(), at);
    for (const ColumnJob& column : data.inputs->columns) {
        const auto& entry = at.job.model.system->inputs()[static_cast<std::size_t>(column.coordinate)];
        inputs[std::string(entry.name)] = fields_document(column, column_fields());
    }
    return inputs;
}

}  // namespace

void add_file_fields(FieldTable<DataJob>& table) {
    static const FieldTable<InputJob> interpolation{
        choice_field(key("interpolation", {}, "Of the inputs between their samples.").with("inputs"),
                     interpolation_names, &InputJob::interpolation),
        Field<InputJob>{key("delay", number() | text("a parameter of the model"),
                            "The model reads the inputs of so much earlier; may be negative. A parameter can be "
                            "estimated.")
                            .in("s")
                            .with("inputs")
                            .by_default(0.0),
                        read_delay,
                        [](const InputJob& input, const Writing& at) {
                            return input.delay_parameter ? Json(parameter_name(at.job, *input.delay_parameter))
                                                         : Json(input.delay);
                        }}
            .written_if([](const InputJob& input) { return input.delay_parameter || input.delay != 0.0; })};
    table.push_back(
        {key("file", file_name(), "Recorded data: .csv, .tsv, .txt, .mat, .h5 or .hdf5, relative to the job."),
         read_recorded_file, [](const DataJob& data, const Writing& at) {
             return data.file && data.file->pattern.empty() ? Json(path_text(data.file->paths.front(), at.folder))
                                                            : left_out();
         }});
    table.push_back({key("files", file_name(),
                         "Several such files by a pattern with * and ?, each a segment that is named after its file."),
                     read_recorded_files, [](const DataJob& data, const Writing& at) {
                         return data.file && !data.file->pattern.empty()
                                    ? Json(path_text(data.file->pattern, at.folder))
                                    : left_out();
                     }});
    add_fields_of(
        table, recorded_file_fields(), [](auto& data) -> auto& { return *data.file; });
    add_fields_of(
        table, record_part_fields(), [](auto& data) -> auto& { return *data.file; });
    table.push_back({key("inputs", entries(column(), "an input of the model", keys_of(input_file_fields())),
                         "Columns of the measured inputs that the model reads."),
                     read_inputs, inputs_document});
    add_fields_of(
        table, interpolation, [](auto& data) -> auto& { return *data.inputs; });
}

void take_default_columns(const Job& job, FileJob& file) {
    file.segment_column = "segment";
    const bool autonomous = job.model.is(models::Kind::autonomous);
    if ((file.sampling == Sampling::samples && file.step == 0.0) || autonomous) file.time_column = "t";
    if (!job.model.system) return;
    for (const models::Coordinate& coordinate : job.model.system->coordinates()) {
        const auto index = static_cast<Eigen::Index>(file.columns.size());
        file.columns.push_back({index, std::string(coordinate.name), std::string(coordinate.unit), 1, 0.0});
    }
}

}  // namespace orbid::apps::describe
