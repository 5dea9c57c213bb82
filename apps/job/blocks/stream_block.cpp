#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;

/// MB for points and search; twice as much is within a small machine, and in ten minutes searched.
constexpr double usual_stream_memory = 1000.0, least_stream_memory = 16.0;

/// Of "stream".
const FieldTable<FileJob>& stream_fields() {
    static const FieldTable<FileJob> table{
        {key("memory", at_least(least_stream_memory),
             "For the points that are held at a time, and what is done to them.")
             .in("MB")
             .by_default(usual_stream_memory),
         [](const ValueReader& value, const Job&, FileJob& file) { value.read(file.stream_memory); },
         [](const FileJob& file, const Writing&) -> Json { return file.stream_memory; }}};
    return table;
}

/// true, false, or { "memory": 500 }.
void read_stream(const ValueReader& value, const Job& job, FileJob& file) {
    const bool described = value.is(JsonValue::Kind::object);
    if (!described && !value.boolean().value_or(false)) return;
    file.stream_memory = usual_stream_memory;
    if (described) read_object(value, stream_fields(), file, job);
    if (file.sampling == orbits::Series::Sampling::samples)
        value.report("belongs to \"kind\": \"section\": samples are read as a whole");
    if (file.paths.front().extension() == ".mat")
        value.report("a file of Matlab is read as a whole: write the record as HDF5 or text");
    if (job.section_plane || job.section_from_data || job.model.is(models::Kind::autonomous))
        value.report("belongs to sections of forced models and maps; crossings of a plane are read as a whole");
}

Json stream_document(const FileJob& file, const Writing& at) {
    return fields_document(file, stream_fields(), at);
}

}  // namespace

Field<FileJob> stream_field() {
    return Field<FileJob>{key("stream", boolean() | object(keys_of(stream_fields())),
                              "A section is read piece by piece, never as a whole, in so much memory: for cycles only.")
                              .with_either("file", "files")
                              .by_default(false),
                          read_stream, stream_document}
        .written_if([](const FileJob& file) { return file.stream_memory > 0.0; });
}

}  // namespace orbid::apps::describe
