#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "apps/documents/json_document.hpp"
#include "apps/documents/schema.hpp"

namespace orbid::apps {

[[nodiscard]] inline bool is_in(std::string_view name, const std::vector<std::string>& names) {
    return std::find(names.begin(), names.end(), name) != names.end();
}

/// `; did you mean "x"?`, else `; known: "a", "b"`; nothing when no name is known.
[[nodiscard]] std::string suggestion(std::string_view word, const std::vector<std::string>& known);

/// What a job says where a method is not built.
inline constexpr std::string_view not_in_this_version = "not in this version";

/// A value for a message, shortened so that the message stays one line.
[[nodiscard]] std::string shown_value(const JsonValue& value);

class ObjectReader;

/// A value of the document, its pointer, and the list of its problems.
/// Every reading function that fails reports why and returns nothing.
///
/// A value with a description has already been checked against it (check_described): refused values read as nothing and
/// are not reported again. Reading what the description lacks is our own bug and throws std::logic_error.
class ValueReader {
public:
    ValueReader(const JsonValue& value, std::string pointer, std::vector<Problem>& problems,
                const ValueSchema* description = nullptr)
        : value_(&value), pointer_(std::move(pointer)), problems_(&problems), description_(description) {}

    [[nodiscard]] const JsonValue& value() const { return *value_; }
    [[nodiscard]] const std::string& pointer() const { return pointer_; }
    [[nodiscard]] bool is(JsonValue::Kind kind) const { return value_->kind == kind && !refused(); }
    /// Whether the description has refused it.
    [[nodiscard]] bool refused() const { return value_->flaw == JsonValue::Flaw::itself; }
    /// Whether the description has refused neither it nor anything in it.
    [[nodiscard]] bool sound() const { return value_->flaw == JsonValue::Flaw::none; }

    [[nodiscard]] std::optional<double> number() const;
    /// A number for which `accept` holds; `rule` is the requirement in words ("> 0").
    template <class Accept>
    [[nodiscard]] std::optional<double> number(Accept accept, std::string_view rule) const {
        const auto read = number();
        if (!read || accept(*read)) return read;
        report(fmt::format("must be {}, not {}", rule, *read));
        return std::nullopt;
    }
    /// A whole number in [lowest, highest], highest at most 2^53 (what a JSON number holds exactly).
    [[nodiscard]] std::optional<std::uint64_t> whole(std::uint64_t lowest, std::uint64_t highest) const;
    /// The same for a described value, with the range of its description.
    [[nodiscard]] std::optional<std::uint64_t> whole() const;
    [[nodiscard]] std::optional<bool> boolean() const;
    [[nodiscard]] std::optional<std::string> text() const;
    /// The index of a text among these choices. A described value has the same choices in its description.
    [[nodiscard]] std::optional<std::size_t> choice(const std::vector<std::string>& now) const;
    /// Puts a number, truth value or text into `target`, which stays as it is when the value is refused.
    template <class T>
    void read(T& target) const {
        if constexpr (std::is_same_v<T, bool>) {
            target = boolean().value_or(target);
        } else if constexpr (std::is_arithmetic_v<T>) {
            if (const auto found = number()) target = static_cast<T>(*found);
        } else if constexpr (std::is_same_v<T, std::optional<double>>) {
            target = number();
        } else {
            target = text().value_or(target);
        }
    }
    /// The same for a text among these choices, which are those of the enumeration in its order.
    template <class Enum>
    void choose(const std::vector<std::string>& now, Enum& target) const {
        if (const auto index = choice(now)) target = static_cast<Enum>(*index);
    }
    /// The items of a list; empty after another kind has been reported.
    [[nodiscard]] std::vector<ValueReader> items() const;
    /// The members of an object whose keys are names; empty after another kind has been reported.
    [[nodiscard]] std::vector<std::pair<std::string, ValueReader>> members() const;

    /// Another value read in place of this one (the meaning of a short form), by the description of that meaning. It
    /// must live as long as the reader.
    [[nodiscard]] ValueReader standing_for(const JsonValue& value, const ValueSchema* description) const {
        return {value, pointer_, *problems_, description};
    }

    /// Problems found so far in the whole document.
    [[nodiscard]] std::size_t problem_count() const { return problems_->size(); }

    /// Reports a problem of this value, unless it has been refused already.
    void report(std::string rule) const;
    /// The same for one character of this text, counted from 0.
    void report_character(std::size_t position, std::string rule) const;
    /// Reports that the data this value names cannot be read.
    void report_data(std::string rule) const;
    /// Reports that this is not in this version.
    void report_later(std::string_view what) const;

    /// Reports that a value of another kind was expected ("a number or \"estimate\"").
    void report_kind(std::string_view expected) const;

private:
    friend class ObjectReader;
    const JsonValue* value_;
    std::string pointer_;
    std::vector<Problem>* problems_;
    const ValueSchema* description_;
};

/// An object with known keys. Notes each key asked for; `finish` refuses the rest.
///
/// With a description, unknown and missing keys have been reported before. Then `find` of an undescribed key throws
/// std::logic_error, and so does `finish` of a valid document with a described key that was never read. A key must
/// neither be read without description nor be accepted and ignored.
class ObjectReader {
public:
    /// A value that is not an object is reported; all keys then count as absent, and required ones are not reported
    /// again.
    explicit ObjectReader(const ValueReader& value);

    [[nodiscard]] bool valid() const { return valid_; }
    [[nodiscard]] const ValueReader& self() const { return self_; }

    /// The value of a key; nothing when absent.
    [[nodiscard]] std::optional<ValueReader> find(std::string_view key);
    /// The same; an absent key is reported with its expected content.
    [[nodiscard]] std::optional<ValueReader> require(std::string_view key, std::string_view meaning);
    /// Reads a key into `target`, which stays as it is when the key is absent or its value refused.
    /// @return the value; nothing when absent.
    template <class T>
    std::optional<ValueReader> read(std::string_view key, T& target) {
        auto found = find(key);
        if (found) found->read(target);
        return found;
    }
    template <class Enum>
    std::optional<ValueReader> choose(std::string_view key, const std::vector<std::string>& now, Enum& target) {
        auto found = find(key);
        if (found) found->choose(now, target);
        return found;
    }
    /// The description of a key's value; null without one.
    [[nodiscard]] const ValueSchema* description_of(std::string_view key) const;
    /// Reports every key never read.
    void finish() const;

    /// Reports a problem at a key (its name, not its value).
    void report(std::string_view key, std::string rule) const;

private:
    ValueReader self_;
    bool valid_;
    std::vector<std::string> known_;
};

}  // namespace orbid::apps
