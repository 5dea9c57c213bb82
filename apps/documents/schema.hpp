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

/// What a JSON document may contain, as plain data. Checking a document (schema_check.hpp), writing a JSON Schema
/// (json_schema.hpp) and writing a page of reference (schema_page.hpp) all follow these.

struct ObjectSchema;
struct ValueSchema;

struct NumberSchema {
    bool whole = false;
    double lowest = -std::numeric_limits<double>::infinity();
    double highest = std::numeric_limits<double>::infinity();
    bool above_lowest = false;      ///< the lowest itself is excluded
    bool below_highest = false;     ///< the highest itself is excluded
    std::vector<double> only = {};  ///< these numbers alone, unless empty
    std::optional<double> except = {};
};

struct TextSchema {
    std::vector<std::string> choices;             ///< empty: any text
    bool (*accepts)(std::string_view) = nullptr;  ///< null: any text
    std::string pattern;                          ///< equivalent regular expression, for the schema
    std::string rule = "a text";                  ///< in words
};

struct ListSchema {
    std::shared_ptr<const ValueSchema> item;
    std::size_t fewest = 0;
    std::size_t most = std::numeric_limits<std::size_t>::max();
    bool unique = false;
    std::string rule;  ///< what the whole list must be, in words; empty: from the counts
};

/// The forms of a value, at most one of each kind of JSON.
struct ValueSchema {
    std::string name;  ///< if several keys share it; empty: described in place
    /// The same for the object only, which may be one of several forms (an experiment, or a list of them).
    std::string object_name;
    bool anything = false;
    bool null = false;
    bool boolean = false;
    std::optional<NumberSchema> number;
    std::optional<TextSchema> text;
    std::optional<ListSchema> list;
    std::shared_ptr<const ObjectSchema> object;

    /// Whether a form is of this kind.
    [[nodiscard]] bool allows(JsonValue::Kind kind) const;
    /// Whether its object is described under its own name, separately from the value.
    [[nodiscard]] bool shares_object() const { return !object_name.empty() && name != object_name; }
    /// Only that object, under its name.
    [[nodiscard]] ValueSchema shared_object() const;
};

/// Another key of the same object exists, or has one of these texts.
struct Condition {
    std::string key;
    std::vector<std::string> values;  ///< empty: the key exists
    std::string or_key = {};          ///< instead of which this one may exist; empty: none
};

struct KeySchema {
    std::string key;
    ValueSchema value;
    std::string text;                            ///< one sentence
    std::string default_value;                   ///< the default as JSON; empty: none, or explained in the text
    std::string unit;                            ///< empty: none, or that of the key's quantity
    bool required = false;                       ///< where `only_with` holds
    std::optional<Condition> only_with;          ///< refused otherwise
    std::optional<Condition> required_with;      ///< required there, allowed elsewhere
    std::optional<std::string> required_unless;  ///< required without this key
    std::optional<std::string> never_beside;     ///< a key that this one excludes
    std::string refused;                         ///< why the key is refused; empty: it is not

    KeySchema& required_always() {
        required = true;
        return *this;
    }
    KeySchema& with(std::string other, std::vector<std::string> values = {}) {
        only_with = Condition{std::move(other), std::move(values)};
        return *this;
    }
    KeySchema& with_either(std::string one, std::string other) {
        only_with = Condition{std::move(one), {}, std::move(other)};
        return *this;
    }
    KeySchema& needed_with(std::string other, std::vector<std::string> values = {}) {
        required_with = Condition{std::move(other), std::move(values)};
        return *this;
    }
    KeySchema& needed_unless(std::string other) {
        required_unless = std::move(other);
        return *this;
    }
    KeySchema& without(std::string other) {
        never_beside = std::move(other);
        return *this;
    }
    KeySchema& in(std::string unit_name) {
        unit = std::move(unit_name);
        return *this;
    }
    KeySchema& refuse(std::string_view why) {
        refused = why;
        return *this;
    }
    KeySchema& standard_text(std::string_view json) {
        default_value = json;
        return *this;
    }
    KeySchema& by_default(const char* text_value);
    KeySchema& by_default(bool flag);
    KeySchema& by_default(double number);
    KeySchema& by_default(const std::vector<int>& numbers);
    template <std::integral Whole>
    requires(!std::same_as<Whole, bool>) KeySchema& by_default(Whole number) {
        return by_default(static_cast<double>(number));
    }
};

/// Members whose keys are names: of parameters, coordinates, experiments.
struct EntriesSchema {
    std::shared_ptr<const ValueSchema> value;
    std::string names;  ///< what they name: "a parameter of the model"
};

struct ObjectSchema {
    std::vector<KeySchema> keys;
    std::optional<EntriesSchema> entries;
    std::vector<std::string> exactly_one;  ///< of these keys; empty: no such rule
    std::size_t fewest = 0;                ///< members

    /// The description of a key; null when there is none of this name.
    [[nodiscard]] const KeySchema* find(std::string_view key) const;
    /// The description of a member's value: of the key, else of an entry; null when there is neither.
    [[nodiscard]] const ValueSchema* value_of(std::string_view key) const;
};

/// "a number, \"estimate\" or { \"estimate\": ... }": allowed values, for messages.
[[nodiscard]] std::string in_words(const ValueSchema& value);
/// "> 0 and < 0.5", "a whole number from 1 to 64": allowed numbers; empty when any is.
[[nodiscard]] std::string rule(const NumberSchema& number);
/// "\"a\", \"b\""
[[nodiscard]] std::string quoted_list(const std::vector<std::string>& names);

/// The parts of schemas.
namespace describe {

[[nodiscard]] ValueSchema anything();
[[nodiscard]] ValueSchema null();
[[nodiscard]] ValueSchema boolean();
[[nodiscard]] ValueSchema number();
[[nodiscard]] ValueSchema above(double lowest);
[[nodiscard]] ValueSchema at_least(double lowest);
/// lowest < x < highest
[[nodiscard]] ValueSchema between(double lowest, double highest);
/// lowest < x <= highest
[[nodiscard]] ValueSchema above_up_to(double lowest, double highest);
/// lowest <= x <= highest
[[nodiscard]] ValueSchema from_to(double lowest, double highest);
[[nodiscard]] ValueSchema one_of(std::vector<double> numbers);
[[nodiscard]] ValueSchema other_than(double number);
[[nodiscard]] ValueSchema whole(double lowest, double highest);
[[nodiscard]] ValueSchema text(std::string rule = "a text");
/// A text that `accepts` accepts; the regular expression is equivalent. (A library of these would not survive a hostile
/// text: its recursion is as deep as the text is long.)
[[nodiscard]] ValueSchema text_like(bool (*accepts)(std::string_view), std::string pattern, std::string rule);
[[nodiscard]] ValueSchema choice(std::vector<std::string> choices);
[[nodiscard]] ValueSchema list(ValueSchema item, std::size_t fewest = 0,
                               std::size_t most = std::numeric_limits<std::size_t>::max(), std::string rule = "");
/// Items are different from each other.
[[nodiscard]] ValueSchema set(ValueSchema item, std::size_t fewest = 0);
[[nodiscard]] ValueSchema object(std::vector<KeySchema> keys, std::vector<std::string> exactly_one = {});
/// Members under names; `keys` are names with a special meaning among them.
[[nodiscard]] ValueSchema entries(ValueSchema value, std::string names, std::vector<KeySchema> keys = {},
                                  std::size_t fewest = 0);
[[nodiscard]] ValueSchema named(std::string name, ValueSchema value);
[[nodiscard]] KeySchema key(std::string name, ValueSchema value, std::string text);

}  // namespace describe

/// Either of two descriptions, without a common kind of JSON.
[[nodiscard]] ValueSchema operator|(ValueSchema one, const ValueSchema& other);

}  // namespace orbid::apps
