#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "apps/campaign/plan/campaign_fields.hpp"
#include "apps/documents/file_pattern.hpp"
#include "apps/job/blocks/field_kinds.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;
using namespace describe;
using Values = std::vector<Json>;

/// { "from": 1, "to": 100, "count": 5, "spacing": "log" }
struct Range {
    double from = 0.0;
    double to = 1.0;
    std::size_t count = 2;
    bool logarithmic = false;
};

const FieldTable<Range>& range_fields() {
    static const FieldTable<Range> table{
        open_field(key("from", number(), "First value.").required_always(), &Range::from),
        open_field(key("to", number(), "Last value.").required_always(), &Range::to),
        open_field(key("count", whole(2, 1e9), "How many, both ends included.").required_always(), &Range::count),
        word_field(key("spacing", {}, "Equal differences or equal ratios."), {{false, "linear"}, {true, "log"}},
                   &Range::logarithmic)};
    return table;
}

/// The values of a range; both ends are met exactly, whole values stay whole.
Values range_values(const ValueReader& value) {
    Range range;
    read_object(value, range_fields(), range);
    if (!value.sound()) return {};
    if (range.logarithmic && (range.from <= 0.0 || range.to <= 0.0)) {
        value.report("\"spacing\": \"log\" needs ends > 0");
        return {};
    }
    if (range.count > 10'000'000) {
        value.report(fmt::format("makes {} values, at most 10000000 can be run", range.count));
        return {};
    }
    Values values;
    const bool whole = !range.logarithmic && range.from == std::floor(range.from) &&
                       std::fmod(range.to - range.from, static_cast<double>(range.count - 1)) == 0.0 &&
                       std::abs(range.from) < largest_exact && std::abs(range.to) < largest_exact;
    for (std::size_t i = 0; i < range.count; ++i) {
        const double share = static_cast<double>(i) / static_cast<double>(range.count - 1);
        double x = range.logarithmic ? range.from * std::pow(range.to / range.from, share)
                                     : range.from + share * (range.to - range.from);
        if (i + 1 == range.count) x = range.to;
        values.push_back(whole ? Json(std::llround(x)) : Json(x));
    }
    return values;
}

struct Variation {
    std::string name;
    std::vector<std::string> names;
    std::vector<std::string> pointers;
    std::vector<std::vector<Json>> settings;
    bool multiplied = false;
    std::optional<VariedDraw> draw;
};

void add_settings(const Values& values, Variation& variation) {
    for (const Json& value : values)
        variation.settings.push_back({value});
}

Values file_values(const ValueReader& value, const Job& place) {
    Values values;
    const auto pattern = value.text();
    if (!pattern) return values;
    const auto full = (place.source.parent_path() / *pattern).lexically_normal().string();
    const auto paths = matching_files(full);
    if (paths.empty()) value.report_data(fmt::format("no file matches \"{}\"", full));
    for (const auto& path : paths)
        values.emplace_back(path.string());
    return values;
}

ValueSchema pointer() {
    return text_like([](std::string_view text) { return text.size() > 1 && text.front() == '/'; }, "^/.+",
                     "a JSON Pointer into the job, as \"/model/parameters/k\"");
}

VariedDraw read_draw(const ValueReader& value) {
    using Distribution = VariedDraw::Distribution;
    VariedDraw draw;
    ObjectReader object(value);
    const auto take = [&](const char* name, Distribution distribution, bool ascending) {
        const auto found = object.find(name);
        if (!found) return;
        const Eigen::VectorXd numbers = read_numbers(*found);
        if (numbers.size() != 2) return;
        draw.distribution = distribution;
        draw.first = numbers[0];
        draw.second = numbers[1];
        if (ascending && !(numbers[0] < numbers[1])) found->report("[lower, upper] must ascend");
        if (distribution == Distribution::log_uniform && numbers[0] <= 0.0) found->report("must be > 0");
        if (distribution == Distribution::normal && numbers[1] <= 0.0) found->report("[mean, sd]: sd must be > 0");
    };
    take("uniform", Distribution::uniform, true);
    take("log_uniform", Distribution::log_uniform, true);
    take("normal", Distribution::normal, false);
    object.finish();
    return draw;
}

ValueSchema draw_value() {
    return object({key("uniform", list(number(), 2, 2, "[lower, upper]"), "Between two numbers."),
                   key("log_uniform", list(above(0.0), 2, 2, "[lower, upper]"), "The same for the logarithm."),
                   key("normal", list(number(), 2, 2, "[mean, sd]"), "Normal distribution.")},
                  {"uniform", "log_uniform", "normal"});
}

/// An item of "vary". The written values are taken from the file as they are.
FieldTable<Variation> variation_fields(const CampaignText* file) {
    return {
        reading_field<Variation>(
            key("name", text_like([](std::string_view word) { return !word.empty(); }, "^.+", "a name"),
                "Column of tables; without it the key's last word.")
                .with("key"),
            [](const ValueReader& value, const Job&, Variation& one) { value.read(one.name); }),
        reading_field<Variation>(key("key", pointer(), "What varies: a place in the job."),
                                 [](const ValueReader& value, const Job&, Variation& one) {
                                     if (const auto place = value.text()) one.pointers = {*place};
                                 }),
        reading_field<Variation>(key("keys", set(pointer(), 2), "Several that take their values together."),
                                 [](const ValueReader& value, const Job&, Variation& one) {
                                     for (const ValueReader& item : value.items())
                                         one.pointers.push_back(item.text().value_or(""));
                                 }),
        reading_field<Variation>(
            key("values", list(anything(), 1), "Its values; of several keys a list of lists, one value for each key."),
            [file](const ValueReader& value, const Job&, Variation& one) {
                for (const ValueReader& item : value.items()) {
                    const Json& written = file->written(item);
                    if (one.pointers.size() < 2) {
                        one.settings.push_back({written});
                    } else if (written.is_array() && written.size() == one.pointers.size()) {
                        one.settings.emplace_back(written.begin(), written.end());
                    } else {
                        item.report(
                            fmt::format("must be a list of {} values, one for each of \"keys\"", one.pointers.size()));
                    }
                }
            })
            .read_after("keys"),
        reading_field<Variation>(
            key("range", object(keys_of(range_fields())), "Evenly spaced values.").with("key"),
            [](const ValueReader& value, const Job&, Variation& one) { add_settings(range_values(value), one); }),
        reading_field<Variation>(
            key("files", text("a pattern"), "Paths of all files that match a pattern.").with("key"),
            [](const ValueReader& value, const Job& place, Variation& one) {
                add_settings(file_values(value, place), one);
            }),
        reading_field<Variation>(
            key("multiply_by", list(number(), 1), "All numbers there are multiplied by each of these.").with("key"),
            [file](const ValueReader& value, const Job&, Variation& one) {
                for (const ValueReader& item : value.items())
                    one.settings.push_back({file->written(item)});
                one.multiplied = true;
            }),
        reading_field<Variation>(
            key("draw", draw_value(), "A value drawn for every replicate.").with("key"),
            [](const ValueReader& value, const Job&, Variation& one) { one.draw = read_draw(value); })};
}

void read_variation(const ValueReader& value, CampaignText& text) {
    Variation one;
    read_object(value, variation_fields(&text), one, text.place);
    if (!value.sound() || one.pointers.empty()) return;
    for (const std::string& pointer : one.pointers)
        one.names.push_back(!one.name.empty() ? one.name : column_name(pointer));
    if (one.draw) {
        one.draw->name = one.names.front();
        one.draw->pointer = one.pointers.front();
        text.campaign.draws.push_back(*one.draw);
    } else {
        text.campaign.factors.push_back({one.names, one.pointers, one.settings, one.multiplied});
    }
}

ValueSchema variation() {
    ValueSchema schema =
        object(keys_of(variation_fields(nullptr)), {"values", "range", "files", "multiply_by", "draw"});
    auto keys = std::make_shared<ObjectSchema>(*schema.object);
    for (KeySchema& each : keys->keys) {
        if (each.key == "key") each.needed_unless("keys").without("keys");
    }
    schema.object = keys;
    return schema;
}

ValueSchema grid_value() {
    return list(number(), 1) | object(keys_of(range_fields()));
}

void read_grid(const ValueReader& value, const Job&, CampaignText& text) {
    for (const auto& [parameter, member] : value.members()) {
        VariedFactor factor{{parameter}, {child_pointer("/model/parameters", parameter)}, {}, false};
        Values values;
        if (member.is(JsonValue::Kind::array)) {
            for (const ValueReader& item : member.items())
                values.push_back(text.written(item));
        } else {
            values = range_values(member);
        }
        for (const Json& each : values)
            factor.settings.push_back({each});
        text.campaign.held.push_back(parameter);
        text.campaign.factors.push_back(std::move(factor));
    }
}

void read_records(const ValueReader& value, const Job& place, CampaignText& text) {
    VariedFactor factor{{"record"}, {text.record_key}, {}, false};
    for (const Json& path : file_values(value, place))
        factor.settings.push_back({path});
    text.campaign.factors.push_back(std::move(factor));
}

}  // namespace

void add_variation_fields(FieldTable<CampaignText>& table) {
    table.push_back(reading_field<CampaignText>(
        key("vary", list(named("variation", variation()), 1), "What varies, each with all of the others' values."),
        [](const ValueReader& value, const Job&, CampaignText& text) {
            for (const ValueReader& item : value.items())
                read_variation(item, text);
        }));
    table.push_back(
        reading_field<CampaignText>(key("grid", entries(grid_value(), "a parameter of the model", {}, 1),
                                        "Values at which parameters are held while the others are estimated.")
                                        .with("kind", {"profile_grid"})
                                        .needed_with("kind", {"profile_grid"}),
                                    read_grid));
    table.push_back(reading_field<CampaignText>(key("records", text("a pattern"), "Data files, one task each.")
                                                    .with("kind", {"records"})
                                                    .needed_with("kind", {"records"}),
                                                read_records)
                        .read_after("record_key"));
    table.push_back(reading_field<CampaignText>(
        key("record_key", pointer(), "Which key of the job names its record.")
            .with("kind", {"records"})
            .by_default("/data/file"),
        [](const ValueReader& value, const Job&, CampaignText& text) { value.read(text.record_key); }));
}

}  // namespace orbid::apps
