#include "apps/documents/json_schema.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

/// Whole numbers without a fraction, so that the schema shows 64 and not 64.0.
Json plain_number(double number) {
    // Doubles up to 2^53 hold whole numbers exactly.
    if (std::trunc(number) == number && std::abs(number) <= 9007199254740992.0)
        return static_cast<std::int64_t>(number);
    return number;
}

class Writer {
public:
    Json schema(const ValueSchema& value) {
        if (value.name.empty()) return forms(value);
        if (definitions_.find(value.name) == definitions_.end()) {
            definitions_[value.name] = nullptr;  // its place: before what it refers to
            Json written = forms(value);
            definitions_[value.name] = std::move(written);
        }
        return {{"$ref", "#/$defs/" + value.name}};
    }

    [[nodiscard]] const Json& definitions() const { return definitions_; }

private:
    Json forms(const ValueSchema& value) {
        if (value.anything) return Json::object();
        Json list = Json::array();
        if (value.number) list.push_back(number(*value.number));
        if (value.boolean) list.push_back({{"type", "boolean"}});
        if (value.text) list.push_back(text(*value.text));
        if (value.list) list.push_back(items(*value.list));
        if (value.object) list.push_back(value.shares_object() ? schema(value.shared_object()) : object(*value.object));
        if (value.null) list.push_back({{"type", "null"}});
        if (list.size() == 1) return list.front();
        return {{"oneOf", std::move(list)}};
    }

    static Json number(const NumberSchema& form) {
        if (!form.only.empty()) {
            Json list = Json::array();
            for (const double each : form.only)
                list.push_back(plain_number(each));
            return {{"enum", std::move(list)}};
        }
        Json written{{"type", form.whole ? "integer" : "number"}};
        if (std::isfinite(form.lowest))
            written[form.above_lowest ? "exclusiveMinimum" : "minimum"] = plain_number(form.lowest);
        if (std::isfinite(form.highest))
            written[form.below_highest ? "exclusiveMaximum" : "maximum"] = plain_number(form.highest);
        if (form.except) written["not"] = {{"const", plain_number(*form.except)}};
        return written;
    }

    static Json text(const TextSchema& form) {
        if (!form.choices.empty()) return {{"enum", form.choices}};
        Json written{{"type", "string"}};
        if (!form.pattern.empty()) written["pattern"] = form.pattern;
        return written;
    }

    Json items(const ListSchema& form) {
        Json written{{"type", "array"}, {"items", schema(*form.item)}};
        if (form.fewest > 0) written["minItems"] = form.fewest;
        if (form.most < std::numeric_limits<std::size_t>::max()) written["maxItems"] = form.most;
        if (form.unique) written["uniqueItems"] = true;
        return written;
    }

    Json member(const KeySchema& entry) {
        Json written = schema(entry.value);
        written["description"] = entry.unit.empty() ? entry.text : fmt::format("[{}] {}", entry.unit, entry.text);
        if (!entry.default_value.empty()) written["default"] = Json::parse(entry.default_value);
        return written;
    }

    static Json holds(const Condition& condition, const ObjectSchema& form) {
        Json written{{"properties", {{condition.key, {{"enum", condition.values}}}}}};
        // An absent key counts as its default.
        const KeySchema* other = form.find(condition.key);
        const bool usual = std::any_of(condition.values.begin(), condition.values.end(), [&](const auto& value) {
            return other != nullptr && other->default_value == fmt::format("\"{}\"", value);
        });
        if (!usual) written["required"] = {condition.key};
        return written;
    }

    /// What a key demands of others.
    static void add_rules(const KeySchema& entry, const ObjectSchema& form, Json& written, Json& rules) {
        if (entry.never_beside) written["dependentSchemas"][*entry.never_beside]["properties"][entry.key] = false;
        if (entry.only_with && !entry.only_with->or_key.empty()) {
            Json rule{
                {"if",
                 {{"anyOf", {{{"required", {entry.only_with->key}}}, {{"required", {entry.only_with->or_key}}}}}}}};
            if (entry.required) rule["then"] = {{"required", {entry.key}}};
            rule["else"] = {{"properties", {{entry.key, false}}}};
            rules.push_back(std::move(rule));
        } else if (entry.only_with && entry.only_with->values.empty()) {
            written["dependentRequired"][entry.key].push_back(entry.only_with->key);
            if (entry.required) written["dependentRequired"][entry.only_with->key].push_back(entry.key);
        } else if (entry.only_with) {
            Json rule{{"if", holds(*entry.only_with, form)}};
            if (entry.required) rule["then"] = {{"required", {entry.key}}};
            rule["else"] = {{"properties", {{entry.key, false}}}};
            rules.push_back(std::move(rule));
        }
        if (entry.required_unless)
            rules.push_back({{"anyOf", {{{"required", {entry.key}}}, {{"required", {*entry.required_unless}}}}}});
        if (entry.required_with && entry.required_with->values.empty())
            written["dependentRequired"][entry.required_with->key].push_back(entry.key);
        else if (entry.required_with)
            rules.push_back({{"if", holds(*entry.required_with, form)}, {"then", {{"required", {entry.key}}}}});
    }

    Json object(const ObjectSchema& form) {
        Json written{{"type", "object"}};
        Json properties = Json::object();
        Json required = Json::array();
        Json rules = Json::array();
        for (const KeySchema& entry : form.keys) {
            if (!entry.refused.empty()) {
                if (form.entries) properties[entry.key] = false;
                continue;
            }
            properties[entry.key] = member(entry);
            if (entry.required && !entry.only_with && !entry.never_beside) required.push_back(entry.key);
            add_rules(entry, form, written, rules);
        }
        if (!properties.empty()) written["properties"] = std::move(properties);
        written["additionalProperties"] = form.entries ? schema(*form.entries->value) : Json(false);
        if (!required.empty()) written["required"] = std::move(required);
        if (form.fewest > 0) written["minProperties"] = form.fewest;
        for (const std::string& key : form.exactly_one)
            written["oneOf"].push_back({{"required", {key}}});
        if (!rules.empty()) written["allOf"] = std::move(rules);
        return written;
    }

    Json definitions_ = Json::object();
};

}  // namespace

nlohmann::ordered_json json_schema(const ValueSchema& description) {
    Writer writer;
    Json document{{"$schema", "https://json-schema.org/draft/2020-12/schema"}};
    document.update(writer.schema(description));
    document["$defs"] = writer.definitions();
    return document;
}

}  // namespace orbid::apps
