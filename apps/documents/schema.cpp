#include "apps/documents/schema.hpp"

#include <algorithm>
#include <cassert>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace orbid::apps {

namespace {

// Of an object among other forms, so many keys are shown in a message.
constexpr std::size_t most_keys_shown = 4;

std::string object_in_words(const ObjectSchema& object, bool alone) {
    if (alone || object.keys.empty()) return "an object { ... }";
    std::string keys;
    std::size_t shown = 0;
    for (const KeySchema& entry : object.keys) {
        if (!entry.refused.empty()) continue;
        if (shown++ == most_keys_shown) {
            keys += ", ...";
            break;
        }
        keys += fmt::format("{}\"{}\": ...", shown > 1 ? ", " : "", entry.key);
    }
    return fmt::format("{{ {} }}", keys);
}

}  // namespace

bool ValueSchema::allows(JsonValue::Kind kind) const {
    switch (kind) {
        case JsonValue::Kind::null:
            return anything || null;
        case JsonValue::Kind::boolean:
            return anything || boolean;
        case JsonValue::Kind::number:
            return anything || number.has_value();
        case JsonValue::Kind::string:
            return anything || text.has_value();
        case JsonValue::Kind::array:
            return anything || list.has_value();
        case JsonValue::Kind::object:
            return anything || object != nullptr;
    }
    return false;
}

ValueSchema ValueSchema::shared_object() const {
    ValueSchema value;
    value.name = value.object_name = object_name;
    value.object = object;
    return value;
}

KeySchema& KeySchema::by_default(const char* text_value) {
    default_value = fmt::format("\"{}\"", text_value);
    return *this;
}

KeySchema& KeySchema::by_default(bool flag) {
    default_value = flag ? "true" : "false";
    return *this;
}

KeySchema& KeySchema::by_default(double number) {
    default_value = fmt::format("{}", number);
    return *this;
}

KeySchema& KeySchema::by_default(const std::vector<int>& numbers) {
    default_value = fmt::format("[{}]", fmt::join(numbers, ", "));
    return *this;
}

const KeySchema* ObjectSchema::find(std::string_view key) const {
    const auto found = std::find_if(keys.begin(), keys.end(), [&](const KeySchema& entry) { return entry.key == key; });
    return found == keys.end() ? nullptr : &*found;
}

const ValueSchema* ObjectSchema::value_of(std::string_view key) const {
    if (const KeySchema* found = find(key)) return &found->value;
    return entries ? entries->value.get() : nullptr;
}

std::string quoted_list(const std::vector<std::string>& names) {
    std::string list;
    for (const std::string& name : names)
        list += fmt::format("{}\"{}\"", list.empty() ? "" : ", ", name);
    return list;
}

std::string in_words(const ValueSchema& value) {
    std::vector<std::string> forms;
    const int count = static_cast<int>(value.null) + static_cast<int>(value.boolean) +
                      static_cast<int>(value.number.has_value()) + static_cast<int>(value.text.has_value()) +
                      static_cast<int>(value.list.has_value()) + static_cast<int>(value.object != nullptr);
    const bool alone = count == 1;
    if (value.number) forms.emplace_back(value.number->whole ? "a whole number" : "a number");
    if (value.boolean && alone) forms.emplace_back("true or false");
    if (value.boolean && !alone) forms.insert(forms.end(), {"true", "false"});
    if (value.text) {
        const auto& choices = value.text->choices;
        forms.push_back(choices.empty()               ? value.text->rule
                        : alone && choices.size() > 1 ? "one of " + quoted_list(choices)
                                                      : quoted_list(choices));
    }
    if (value.list) forms.emplace_back("a list [ ... ]");
    if (value.object) forms.push_back(object_in_words(*value.object, alone));
    if (value.null) forms.emplace_back("null");
    if (forms.empty()) return "any value";
    if (forms.size() == 1) return forms.front();
    const std::vector<std::string> first(forms.begin(), forms.end() - 1);
    return fmt::format("{} or {}", fmt::join(first, ", "), forms.back());
}

std::string rule(const NumberSchema& number) {
    if (!number.only.empty()) return fmt::format("one of {}", fmt::join(number.only, ", "));
    if (number.except) return fmt::format("other than {}", *number.except);
    const double infinity = std::numeric_limits<double>::infinity();
    if (number.whole) {
        // Bounds are whole and at most 2^53: shown without exponent.
        return fmt::format("a whole number from {:.0f} to {:.0f}", number.lowest, number.highest);
    }
    std::string text;
    if (number.lowest != -infinity) text = fmt::format("{} {}", number.above_lowest ? ">" : ">=", number.lowest);
    if (number.highest != infinity)
        text += fmt::format("{}{} {}", text.empty() ? "" : " and ", number.below_highest ? "<" : "<=", number.highest);
    return text;
}

namespace describe {

namespace {

ValueSchema number_in(NumberSchema form) {
    ValueSchema value;
    value.number = std::move(form);
    return value;
}

ValueSchema object_of(ObjectSchema form) {
    ValueSchema value;
    value.object = std::make_shared<const ObjectSchema>(std::move(form));
    return value;
}

}  // namespace

ValueSchema anything() {
    ValueSchema value;
    value.anything = true;
    return value;
}

ValueSchema null() {
    ValueSchema value;
    value.null = true;
    return value;
}

ValueSchema boolean() {
    ValueSchema value;
    value.boolean = true;
    return value;
}

ValueSchema number() {
    return number_in({});
}

ValueSchema at_least(double lowest) {
    return number_in({.lowest = lowest});
}

ValueSchema above(double lowest) {
    return number_in({.lowest = lowest, .above_lowest = true});
}

ValueSchema from_to(double lowest, double highest) {
    return number_in({.lowest = lowest, .highest = highest});
}

ValueSchema above_up_to(double lowest, double highest) {
    return number_in({.lowest = lowest, .highest = highest, .above_lowest = true});
}

ValueSchema between(double lowest, double highest) {
    return number_in({.lowest = lowest, .highest = highest, .above_lowest = true, .below_highest = true});
}

ValueSchema one_of(std::vector<double> numbers) {
    return number_in({.only = std::move(numbers)});
}

ValueSchema other_than(double excluded) {
    return number_in({.except = excluded});
}

ValueSchema whole(double lowest, double highest) {
    return number_in({.whole = true, .lowest = lowest, .highest = highest});
}

ValueSchema text(std::string rule) {
    ValueSchema value;
    value.text.emplace().rule = std::move(rule);
    return value;
}

ValueSchema text_like(bool (*accepts)(std::string_view), std::string pattern, std::string rule) {
    ValueSchema value = text(std::move(rule));
    value.text->accepts = accepts;
    value.text->pattern = std::move(pattern);
    return value;
}

ValueSchema choice(std::vector<std::string> choices) {
    ValueSchema value = text();
    value.text->choices = std::move(choices);
    return value;
}

ValueSchema list(ValueSchema item, std::size_t fewest, std::size_t most, std::string rule) {
    ValueSchema value;
    ListSchema& form = value.list.emplace();
    form.item = std::make_shared<const ValueSchema>(std::move(item));
    form.fewest = fewest;
    form.most = most;
    form.rule = std::move(rule);
    return value;
}

ValueSchema set(ValueSchema item, std::size_t fewest) {
    ValueSchema value = list(std::move(item), fewest);
    value.list->unique = true;
    return value;
}

ValueSchema object(std::vector<KeySchema> keys, std::vector<std::string> exactly_one) {
    return object_of({std::move(keys), std::nullopt, std::move(exactly_one)});
}

ValueSchema entries(ValueSchema value, std::string names, std::vector<KeySchema> keys, std::size_t fewest) {
    EntriesSchema named{std::make_shared<const ValueSchema>(std::move(value)), std::move(names)};
    return object_of({std::move(keys), std::move(named), {}, fewest});
}

ValueSchema named(std::string name, ValueSchema value) {
    const bool object_alone =
        value.object && !(value.null || value.boolean || value.number || value.text || value.list);
    if (object_alone) value.object_name = name;
    value.name = std::move(name);
    return value;
}

KeySchema key(std::string name, ValueSchema value, std::string text) {
    KeySchema entry;
    entry.key = std::move(name);
    entry.value = std::move(value);
    entry.text = std::move(text);
    return entry;
}

}  // namespace describe

ValueSchema operator|(ValueSchema one, const ValueSchema& other) {
    assert(!(one.number && other.number) && !(one.text && other.text) && !(one.list && other.list) &&
           !(one.object && other.object));
    // A union of two is no longer what either of them is called.
    one.name.clear();
    one.null = one.null || other.null;
    one.boolean = one.boolean || other.boolean;
    if (other.number) one.number = other.number;
    if (other.text) one.text = other.text;
    if (other.list) one.list = other.list;
    if (other.object) {
        one.object = other.object;
        one.object_name = other.object_name;
    }
    return one;
}

}  // namespace orbid::apps
