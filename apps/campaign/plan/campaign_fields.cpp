#include "apps/campaign/plan/campaign_fields.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"
#include "apps/documents/atomic_file.hpp"
#include "apps/documents/file_pattern.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/job/blocks/field_kinds.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;
using namespace describe;

constexpr double longest_task = 31536000.0;  // a year [s]

/// A job beside the campaign or within it.
void read_job_value(const ValueReader& value, const std::string& name, CampaignText& text) {
    if (value.is(JsonValue::Kind::object)) {
        text.campaign.jobs.push_back({name, text.written(value).dump(2), text.place.source});
    } else if (const auto path = read_path(value, text.place); path && std::filesystem::is_regular_file(*path)) {
        text.campaign.jobs.push_back({name, read_whole_file(*path), *path});
    }
}

void read_jobs(const ValueReader& value, const Job& place, CampaignText& text) {
    if (!value.is(JsonValue::Kind::string)) {
        for (const auto& [name, job] : value.members())
            read_job_value(job, name, text);
        return;
    }
    const auto pattern = value.text();
    if (!pattern) return;
    const auto full = (place.source.parent_path() / *pattern).lexically_normal().string();
    const auto paths = matching_files(full);
    if (paths.empty()) value.report_data(fmt::format("no file matches \"{}\"", full));
    for (const auto& path : paths)
        text.campaign.jobs.push_back({path.stem().string(), read_whole_file(path), path});
}

/// Merged into the jobs, by name, as JSON Merge Patch (RFC 7386): null removes a key.
void change_jobs(const ValueReader& value, const Json& changes, Campaign& campaign) {
    std::vector<std::string> names;
    for (const BaseJob& job : campaign.jobs)
        names.push_back(job.name);
    for (const auto& [name, change] : changes.items()) {
        const auto found = std::find(names.begin(), names.end(), name);
        if (found == names.end()) {
            value.report(fmt::format("there is no job \"{}\"{}", name, suggestion(name, names)));
            continue;
        }
        std::string& text = campaign.jobs[static_cast<std::size_t>(found - names.begin())].text;
        Json job = json_value_or_discarded<Json>(text, true);
        if (!job.is_object()) continue;  // reported where jobs are checked
        job.merge_patch(change);
        text = job.dump(2);
    }
}

void read_changes(const ValueReader& value, const Job&, CampaignText& text) {
    if (value.is(JsonValue::Kind::object)) return change_jobs(value, text.written(value), text.campaign);
    const auto path = read_path(value, text.place);
    if (!path || !std::filesystem::is_regular_file(*path)) return;
    const Json changes = json_value_or_discarded<Json>(read_whole_file(*path), true);
    if (!changes.is_object()) return value.report(fmt::format("\"{}\" is no object of JSON", path->string()));
    change_jobs(value, changes, text.campaign);
}

/// Data are drawn at the estimates of a run: these are the truth, and what simulated data are made by.
void take_estimates(const Json& result, Json& job, Campaign& campaign) {
    for (const auto& [name, estimate] : result["parameters"].items()) {
        if (!estimate.value("value", Json()).is_number()) continue;
        campaign.known.emplace_back("", KnownValue{name, estimate["value"].get<double>()});
        if (job["model"]["parameters"].contains(name))
            set_value(job, child_pointer("/model/parameters", name), estimate["value"]);
    }
    // Noise of simulated readings: series.x is that of the coordinate x.
    Json& data = job["data"];
    if (data.is_array() && data.size() != 1) return;
    Json& one = data.is_array() ? data.front() : data;
    if (!one.contains("simulate") || !one["simulate"].contains("noise")) return;
    const Json errors = result.value("errors", Json::object());
    for (const auto& [group, scale] : errors.items()) {
        const std::string coordinate = group.substr(group.find('.') + 1);
        if (group.starts_with("series.") && one["simulate"]["noise"].contains(coordinate))
            one["simulate"]["noise"][coordinate] = scale.value("sd", Json());
    }
}

/// The folder of a finished run: its job.json.
void read_run(const ValueReader& value, const Job& place, CampaignText& text) {
    const auto folder = value.text();
    if (!folder) return;
    const auto path = (place.source.parent_path() / *folder).lexically_normal();
    for (const char* file : {"job.json", "result.json"})
        if (!std::filesystem::is_regular_file(path / file))
            return value.report_data(fmt::format("\"{}\" is no finished run: it has no {}", path.string(), file));
    Json job = json_value_or_discarded<Json>(read_whole_file(path / "job.json"));
    const Json result = json_value_or_discarded<Json>(read_whole_file(path / "result.json"));
    if (!job.is_object() || !result.is_object() || result.value("parameters", Json::object()).empty())
        return value.report_data(fmt::format("\"{}\" is no run that has estimated parameters", path.string()));
    take_estimates(result, job, text.campaign);
    text.campaign.jobs.push_back({"", job.dump(2), path / "job.json"});
    text.campaign.resampled = true;
}

struct KnownText {
    double value = 0.0;
    double bound = std::numeric_limits<double>::quiet_NaN();
};

const FieldTable<KnownText>& known_fields() {
    static const FieldTable<KnownText> table{
        open_field(key("value", number(), "The true value.").required_always(), &KnownText::value),
        open_field(key("bound", above(0.0), "Least standard deviation that an estimate can have."), &KnownText::bound)};
    return table;
}

/// "k": 3, or "k": { "value": 3, "bound": 0.1 }, from JSON that has no places.
KnownValue known_from(const std::string& parameter, const Json& value, const std::string& where) {
    const Json& number = value.is_object() && value.contains("value") ? value["value"] : value;
    if (!number.is_number())
        throw std::runtime_error(
            fmt::format("{}: \"{}\" must be a number or {{ \"value\": ..., \"bound\": ... }}", where, parameter));
    KnownValue known{parameter, number.get<double>()};
    if (value.is_object() && value.contains("bound") && value["bound"].is_number()) known.bound = value["bound"];
    return known;
}

void read_truth_file(const ValueReader& value, CampaignText& text) {
    const auto path = read_path(value, text.place);
    if (!path || !std::filesystem::is_regular_file(*path)) return;
    const Json document = json_value_or_discarded<Json>(read_whole_file(*path), true);
    if (!document.is_object()) return value.report(fmt::format("\"{}\" is no object of JSON", path->string()));
    try {
        for (const auto& [job, parameters] : document.items())
            for (const auto& [parameter, known] : parameters.items())
                text.campaign.known.emplace_back(job, known_from(parameter, known, path->string() + ": " + job));
    } catch (const std::exception& error) {
        value.report(error.what());
    }
}

void read_truth(const ValueReader& value, const Job&, CampaignText& text) {
    if (value.is(JsonValue::Kind::string)) return read_truth_file(value, text);
    for (const auto& [parameter, member] : value.members()) {
        KnownText known;
        read_short_or_object(member, "value", known_fields(), known);
        text.campaign.known.emplace_back("", KnownValue{parameter, known.value, known.bound});
    }
}

void read_replicates(const ValueReader& value, const Job&, CampaignText& text) {
    if (const auto number = value.whole()) text.campaign.replicates = static_cast<std::int64_t>(*number);
}

const FieldTable<Campaign>& limit_fields() {
    static const FieldTable<Campaign> table{field(
        key("seconds", from_to(0.0, longest_task), "Longest time of a task; 0: none.").in("s"), &Campaign::seconds)};
    return table;
}

/// An object of JSON; what may stand in it is checked where the job is read.
ValueSchema job_part() {
    ValueSchema object = anything();
    object.anything = false;
    object.object = std::make_shared<ObjectSchema>(
        ObjectSchema{{}, EntriesSchema{std::make_shared<ValueSchema>(anything()), "a key of a job"}, {}, 0});
    return object;
}

ValueSchema job_value() {
    return file_name() | job_part();
}

}  // namespace

std::string column_name(const std::string& pointer) {
    static const std::vector<std::string> plain{"start", "value", "sd", "file", "step", "count"};
    const auto last = pointer.rfind('/');
    const std::string name = pointer.substr(last + 1);
    if (!is_in(name, plain) || last == 0 || last == std::string::npos) return name;
    const auto before = pointer.rfind('/', last - 1);
    return pointer.substr(before + 1, last - before - 1) + "_" + name;
}

const FieldTable<CampaignText>& campaign_fields() {
    static const FieldTable<CampaignText> all = [] {
        const std::vector<std::string> counted{"coverage", "bootstrap"};
        FieldTable<CampaignText> table{
            reading_field<CampaignText>(
                key("title", text(), "What the campaign is, for the report.").by_default(""),
                [](const ValueReader& value, const Job&, CampaignText& read) { value.read(read.campaign.title); }),
            reading_field<CampaignText>(key("kind", choice(campaign_kind_names),
                                            "What varies: keys of the job, its noise, records, the models.")
                                            .required_always(),
                                        [](const ValueReader& value, const Job&, CampaignText& read) {
                                            value.choose(campaign_kind_names, read.campaign.kind);
                                            const auto kind = read.campaign.kind;
                                            if (kind == Campaign::Kind::coverage || kind == Campaign::Kind::bootstrap)
                                                read.campaign.seeded = true;
                                        }),
            reading_field<CampaignText>(
                key("job", job_value(), "The job that is varied: its file, or the job itself."),
                [](const ValueReader& value, const Job&, CampaignText& read) { read_job_value(value, "", read); }),
            reading_field<CampaignText>(
                key("jobs", file_name() | entries(job_value(), "the job, as tables call it", {}, 1),
                    "Several jobs by name, or all files that match a pattern."),
                read_jobs),
            reading_field<CampaignText>(
                key("changes", file_name() | entries(job_part(), "a job of \"jobs\"", {}, 1),
                    "Merged into the jobs, by their names, before anything varies; null removes a key.")
                    .with("jobs"),
                read_changes)
                .read_after("jobs"),
            reading_field<CampaignText>(
                key("run", text("a folder"), "A finished run whose data are drawn anew.").with("kind", {"bootstrap"}),
                read_run),
            reading_field<CampaignText>(
                key("seed", seed(), "Of the first replicate; the next ones follow.").by_default(1),
                [](const ValueReader& value, const Job&, CampaignText& read) { value.read(read.campaign.seed); }),
            reading_field<CampaignText>(
                key("replicates", whole(1, 1e9), "How often each setting is run, with other seeds.")
                    .by_default(1)
                    .needed_with("kind", counted),
                read_replicates)};
        add_variation_fields(table);
        table.push_back(reading_field<CampaignText>(
            key("truth", file_name() | entries(number() | object(keys_of(known_fields())), "an estimated parameter"),
                "True values, where the job does not simulate its data; a file holds them by job."),
            read_truth));
        table.push_back(object_field<CampaignText>(key("limit", {}, "When a task is given up."), limit_fields(),
                                                   &CampaignText::campaign));
        return table;
    }();
    return all;
}

const ValueSchema& campaign_description() {
    static const ValueSchema all = [] {
        ValueSchema schema = object(keys_of(campaign_fields()), {"job", "jobs", "run"});
        auto keys = std::make_shared<ObjectSchema>(*schema.object);
        keys->keys.insert(keys->keys.begin(), key("$schema", text(), "The schema of campaigns, for editors."));
        schema.object = keys;
        return schema;
    }();
    return all;
}

}  // namespace orbid::apps
