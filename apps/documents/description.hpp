#pragma once

#include <concepts>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "apps/documents/json_document.hpp"

namespace orbid::apps {

/// What a JSON document may hold, as plain data. Checking a document (description_check.hpp), writing a JSON Schema
/// (description_schema.hpp) and writing a page of reference (description_page.hpp) all follow these.

struct ObjectDescription;
struct ValueDescription;

struct NumberDescription {
    bool whole = false;
    double lowest = -std::numeric_limits<double>::infinity();
    double highest = std::numeric_limits<double>::infinity();
    bool above_lowest = false;   ///< the lowest itself is excluded
    bool below_highest = false;  ///< the highest itself is excluded
    std::vector<double> only;    ///< these numbers alone, unless empty
    std::optional<double> except;
};

struct TextDescription {
    std::vector<std::string> choices;             ///< empty: any text
    std::vector<std::string> later;               ///< further ones that are reserved
    bool (*accepts)(std::string_view) = nullptr;  ///< null: any text
    std::string pattern;                          ///< regular expression that says the same, for the schema
    std::string rule = "a text";                  ///< in words
};

struct ListDescription {
    std::shared_ptr<const ValueDescription> item;
    std::size_t fewest = 0;
    std::size_t most = std::numeric_limits<std::size_t>::max();
    bool unique = false;
    std::string rule;  ///< what the whole list must be, in words; empty: from the counts
};

/// The forms one value may have, at most one of each kind of JSON.
struct ValueDescription {
    std::string name;  ///< of what several keys share; empty: described where it stands
    /// The same of the object alone, which may be one of several forms (an experiment, or a list of them).
    std::string object_name;
    bool anything = false;
    bool null = false;
    bool boolean = false;
    std::optional<NumberDescription> number;
    std::optional<TextDescription> text;
    std::optional<ListDescription> list;
    std::shared_ptr<const ObjectDescription> object;

    /// A form of this kind is among them.
    [[nodiscard]] bool allows(JsonValue::Kind kind) const;
    /// Its object is described under a name of its own, elsewhere than the value.
    [[nodiscard]] bool shares_object() const { return !object_name.empty() && name != object_name; }
    /// That object alone, under its name.
    [[nodiscard]] ValueDescription shared_object() const;
};

/// Another key of the same object is there, or holds one of these texts.
struct Condition {
    std::string key;
    std::vector<std::string> values;  ///< empty: the key is there
};

struct KeyDescription {
    std::string key;
    ValueDescription value;
    std::string text;                        ///< one sentence
    std::string standard;                    ///< the default as JSON; empty: none, or the text says what it depends on
    std::string unit;                        ///< empty: none, or that of what the key is about
    bool required = false;                   ///< where `only_with` holds
    std::optional<Condition> only_with;      ///< refused otherwise
    std::optional<Condition> required_with;  ///< required there, allowed elsewhere
    std::optional<std::string> required_unless;  ///< required where this key is not there
    std::optional<std::string> never_beside;     ///< a key that this one excludes
    std::string refused;                         ///< reserved names: why the key is refused; empty: it is not

    KeyDescription& required_always() {
        required = true;
        return *this;
    }
    KeyDescription& with(std::string other, std::vector<std::string> values = {}) {
        only_with = Condition{std::move(other), std::move(values)};
        return *this;
    }
    KeyDescription& needed_with(std::string other, std::vector<std::string> values = {}) {
        required_with = Condition{std::move(other), std::move(values)};
        return *this;
    }
    KeyDescription& needed_unless(std::string other) {
        required_unless = std::move(other);
        return *this;
    }
    KeyDescription& without(std::string other) {
        never_beside = std::move(other);
        return *this;
    }
    KeyDescription& in(std::string unit_name) {
        unit = std::move(unit_name);
        return *this;
    }
    KeyDescription& refuse(std::string_view why) {
        refused = why;
        return *this;
    }
    KeyDescription& standard_text(std::string_view json) {
        standard = json;
        return *this;
    }
    KeyDescription& by_default(const char* text_value);
    KeyDescription& by_default(bool flag);
    KeyDescription& by_default(double number);
    KeyDescription& by_default(const std::vector<int>& numbers);
    template <std::integral Whole>
    requires(!std::same_as<Whole, bool>) KeyDescription& by_default(Whole number) {
        return by_default(static_cast<double>(number));
    }
};

/// Members whose keys are names: of parameters, coordinates, experiments.
struct EntriesDescription {
    std::shared_ptr<const ValueDescription> value;
    std::string names;  ///< what they name: "a parameter of the model"
};

struct ObjectDescription {
    std::vector<KeyDescription> keys;
    std::optional<EntriesDescription> entries;
    std::vector<std::string> exactly_one;  ///< of these keys; empty: no such rule
    std::size_t fewest = 0;                ///< members

    /// The description of a key; null when there is none of this name.
    [[nodiscard]] const KeyDescription* find(std::string_view key) const;
    /// The description of a member's value: of the key, else of an entry; null when there is neither.
    [[nodiscard]] const ValueDescription* value_of(std::string_view key) const;
};

/// "a number, \"estimate\" or { \"estimate\": ... }": what a value may be, for messages.
[[nodiscard]] std::string in_words(const ValueDescription& value);
/// "> 0 and < 0.5", "a whole number from 1 to 64": what a number must be; empty when any will do.
[[nodiscard]] std::string rule(const NumberDescription& number);
/// "\"a\", \"b\""
[[nodiscard]] std::string quoted_list(const std::vector<std::string>& names);

/// Descriptions are put together from these.
namespace describe {

[[nodiscard]] ValueDescription anything();
[[nodiscard]] ValueDescription null();
[[nodiscard]] ValueDescription boolean();
[[nodiscard]] ValueDescription number();
[[nodiscard]] ValueDescription above(double lowest);
[[nodiscard]] ValueDescription at_least(double lowest);
/// lowest < x < highest
[[nodiscard]] ValueDescription between(double lowest, double highest);
/// lowest < x <= highest
[[nodiscard]] ValueDescription above_up_to(double lowest, double highest);
/// lowest <= x <= highest
[[nodiscard]] ValueDescription from_to(double lowest, double highest);
[[nodiscard]] ValueDescription one_of(std::vector<double> numbers);
[[nodiscard]] ValueDescription other_than(double number);
[[nodiscard]] ValueDescription whole(double lowest, double highest);
[[nodiscard]] ValueDescription text(std::string rule = "a text");
/// A text that `accepts` takes; the regular expression says the same. (A library of these would not survive a hostile
/// text: its recursion is as deep as the text is long.)
[[nodiscard]] ValueDescription text_like(bool (*accepts)(std::string_view), std::string pattern, std::string rule);
[[nodiscard]] ValueDescription choice(std::vector<std::string> choices, std::vector<std::string> later = {});
[[nodiscard]] ValueDescription list(ValueDescription item, std::size_t fewest = 0,
                                    std::size_t most = std::numeric_limits<std::size_t>::max(), std::string rule = "");
/// Items are different from each other.
[[nodiscard]] ValueDescription set(ValueDescription item, std::size_t fewest = 0);
[[nodiscard]] ValueDescription object(std::vector<KeyDescription> keys, std::vector<std::string> exactly_one = {});
/// Members under names; `keys` are the names with a meaning of their own among them.
[[nodiscard]] ValueDescription entries(ValueDescription value, std::string names, std::vector<KeyDescription> keys = {},
                                       std::size_t fewest = 0);
[[nodiscard]] ValueDescription named(std::string name, ValueDescription value);
[[nodiscard]] KeyDescription key(std::string name, ValueDescription value, std::string text);

}  // namespace describe

/// Either of two descriptions, which must not have a kind of JSON in common.
[[nodiscard]] ValueDescription operator|(ValueDescription one, const ValueDescription& other);

}  // namespace orbid::apps
