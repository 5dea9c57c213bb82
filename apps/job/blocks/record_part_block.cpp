#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;

/// Two numbers that must not descend.
template <class Bound>
void read_ends(const ValueReader& value, Bound& first, Bound& last, bool may_be_equal) {
    const Eigen::VectorXd ends = read_numbers(value);
    if (ends.size() != 2) return;
    if (ends[0] < ends[1] || (may_be_equal && ends[0] == ends[1])) {
        first = static_cast<Bound>(ends[0]);
        last = static_cast<Bound>(ends[1]);
    } else {
        value.report(fmt::format("[{}, {}] must ascend", ends[0], ends[1]));
    }
}

/// What a section has no use for.
void refuse_for_sections(const ValueReader& value, const FileJob& file) {
    if (file.sampling == orbits::Series::Sampling::section)
        value.report("belongs to \"kind\": \"samples\"; points of a section follow each other");
}

}  // namespace

const FieldTable<FileJob>& record_part_fields() {
    static const FieldTable<FileJob> table{
        {key("window", list(number(), 2, 2, "[first, last]"), "Times that are read, both included.")
             .in("s")
             .with_either("file", "files"),
         [](const ValueReader& value, const Job&, FileJob& file) {
             read_ends(value, file.part.begin, file.part.end, false);
         },
         [](const FileJob& file, const Writing&) {
             return file.part.windowed() ? Json::array({file.part.begin, file.part.end}) : left_out();
         }},
        {key("rows", list(whole(1.0, largest_exact), 2, 2, "[first, last]"),
             "Rows that are read, counted from 1 without the header, both included.")
             .with_either("file", "files"),
         [](const ValueReader& value, const Job&, FileJob& file) {
             read_ends(value, file.part.first_row, file.part.last_row, true);
         },
         [](const FileJob& file, const Writing&) {
             return file.part.last_row <= static_cast<std::size_t>(largest_exact)
                        ? Json::array({file.part.first_row, file.part.last_row})
                        : left_out();
         }},
        field(key("every", whole(1.0, largest_exact), "One sample in so many is read, without averaging.")
                  .with_either("file", "files"),
              &FileJob::part, &orbits::RecordPart::every)
            .with_rule([](const ValueReader& value, const Job&, FileJob& file) {
                if (file.part.every > 1) refuse_for_sections(value, file);
            })
            .written_if([](const FileJob& file) { return file.part.every > 1; }),
        word_field(
            key("spacing", {}, "Of samples in time; \"any\": each at its own time, as jittered clocks give them.")
                .with_either("file", "files"),
            {{true, "even"}, {false, "any"}}, &FileJob::evenly_spaced)
            .with_rule([](const ValueReader& value, const Job&, FileJob& file) {
                if (!file.evenly_spaced) refuse_for_sections(value, file);
            })
            .written_if([](const FileJob& file) { return !file.evenly_spaced; })};
    return table;
}

}  // namespace orbid::apps::describe
