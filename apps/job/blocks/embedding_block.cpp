#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;

/// Of { "delay": 12, "dimension": 3 }.
const FieldTable<EmbeddingJob>& embedding_fields() {
    constexpr double longest_delay = 1e6;
    constexpr double largest_dimension = 16;
    const auto number_or_auto = [](const char* name, double least, double most, const char* text,
                                   int EmbeddingJob::*member) {
        return Field<EmbeddingJob>{key(name, choice({"auto"}) | whole(least, most), text).by_default("auto"),
                                   [=](const ValueReader& value, const Job&, EmbeddingJob& embedding) {
                                       if (value.is(JsonValue::Kind::string))
                                           (void)value.choice({"auto"});
                                       else
                                           value.read(embedding.*member);
                                   },
                                   [=](const EmbeddingJob& embedding, const Writing&) {
                                       return embedding.*member == 0 ? Json("auto") : Json(embedding.*member);
                                   }};
    };
    static const FieldTable<EmbeddingJob> table{
        number_or_auto("delay", 1, longest_delay,
                       "Samples from one entry of a vector to the next; \"auto\": the first minimum of the mutual "
                       "information.",
                       &EmbeddingJob::delay),
        number_or_auto("dimension", 2, largest_dimension,
                       "Entries of a vector; \"auto\": until neighbours are no longer false.",
                       &EmbeddingJob::dimension)};
    return table;
}

void read_embedding(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    orbits.embedding.emplace();
    if (value.is(JsonValue::Kind::string))
        (void)value.choice({"auto"});
    else
        read_object(value, embedding_fields(), *orbits.embedding, job);
}

}  // namespace

Field<OrbitsJob> embedding_field() {
    return {key("embedding", choice({"auto"}) | object(keys_of(embedding_fields())),
                "Autonomous models of which one coordinate is read: states are vectors of delayed readings."),
            read_embedding, [](const OrbitsJob& orbits, const Writing& at) {
                return orbits.embedding ? fields_document(*orbits.embedding, embedding_fields(), at) : left_out();
            }};
}

void check_embedding(ObjectReader& object, const Job& job, const DataJob& data, bool alone, const OrbitsJob& orbits) {
    const auto at = object.find("embedding").value_or(object.self());
    if (!alone) {
        at.report(fmt::format("embeds one coordinate of an autonomous model in samples: \"{}\" observes {} of {}",
                              data.name, data.observe.size(), job.model.name));
        return;
    }
    const models::Coordinate& coordinate = job.model.coordinate(data.observe.front());
    if (coordinate.angle)
        at.report(fmt::format("{} is an angle, which jumps at the end of its turn: read its sine", coordinate.name));
    if (job.section_plane && job.section_plane->coordinate != data.observe.front())
        at.report(fmt::format("the section is at {}, which is not read: use \"section\": \"auto\", or one at {}",
                              job.model.coordinate(job.section_plane->coordinate).name, coordinate.name));
    if (orbits.search.partition) object.find("partition")->report_later("a partition of vectors of delays");
}

}  // namespace orbid::apps::describe
