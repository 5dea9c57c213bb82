#include "apps/documents/json_reader.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "orbits/records/nearest_name.hpp"

namespace orbid::apps {

namespace {

// A value shown in a message is cut here, so that a message stays one line.
constexpr std::size_t longest_shown = 40;

}  // namespace

std::string shown_value(const JsonValue& value) {
    switch (value.kind) {
        case JsonValue::Kind::boolean:
            return value.boolean ? "true" : "false";
        case JsonValue::Kind::number:
            return fmt::format("{}", value.number);
        case JsonValue::Kind::string:
            return value.text.size() > longest_shown ? fmt::format("\"{}...\"", value.text.substr(0, longest_shown))
                                                     : fmt::format("\"{}\"", value.text);
        default:
            return std::string(description(value.kind));
    }
}

std::string suggestion(std::string_view word, const std::vector<std::string>& known) {
    if (known.empty()) return {};
    if (const auto near = orbits::nearest_name(word, known)) return fmt::format("; did you mean \"{}\"?", *near);
    return "; known: " + quoted_list(known);
}

void ValueReader::report(std::string rule) const {
    if (refused()) return;
    problems_->push_back({value_->place, pointer_, std::move(rule), Problem::Kind::job});
}

void ValueReader::report_character(std::size_t position, std::string rule) const {
    Place place = value_->place;
    // Behind the quotation mark; a text with escapes is only pointed at as a whole.
    if (is(JsonValue::Kind::string) && !value_->escaped) place.column += 1 + position;
    problems_->push_back({place, pointer_, std::move(rule), Problem::Kind::job});
}

void ValueReader::report_data(std::string rule) const {
    problems_->push_back({value_->place, pointer_, std::move(rule), Problem::Kind::data});
}

void ValueReader::report_later(std::string_view what) const {
    report(fmt::format("{}: {}", what, not_in_this_version));
}

void ValueReader::report_kind(std::string_view expected) const {
    report(fmt::format("must be {}, not {}", expected, shown_value(*value_)));
}

std::optional<double> ValueReader::number() const {
    if (!is(JsonValue::Kind::number)) {
        report_kind("a number");
        return std::nullopt;
    }
    return value_->number;
}

std::optional<std::uint64_t> ValueReader::whole(std::uint64_t lowest, std::uint64_t highest) const {
    const auto read = number();
    if (!read) return std::nullopt;
    if (std::trunc(*read) == *read && *read >= static_cast<double>(lowest) && *read <= static_cast<double>(highest))
        return static_cast<std::uint64_t>(*read);
    report(fmt::format("must be a whole number from {} to {}, not {}", lowest, highest, *read));
    return std::nullopt;
}

std::optional<std::uint64_t> ValueReader::whole() const {
    if (description_ == nullptr || !description_->number || !description_->number->whole)
        throw std::logic_error("no whole number is described at " + pointer_);
    const auto read = number();
    if (!read) return std::nullopt;
    return static_cast<std::uint64_t>(*read);
}

std::optional<bool> ValueReader::boolean() const {
    if (!is(JsonValue::Kind::boolean)) {
        report_kind("true or false");
        return std::nullopt;
    }
    return value_->boolean;
}

std::optional<std::string> ValueReader::text() const {
    if (!is(JsonValue::Kind::string)) {
        report_kind("a text");
        return std::nullopt;
    }
    return value_->text;
}

std::optional<std::size_t> ValueReader::choice(const std::vector<std::string>& now) const {
    if (description_ != nullptr && description_->text && !description_->text->choices.empty() &&
        description_->text->choices != now)
        throw std::logic_error("other choices are described than read at " + pointer_);
    if (!is(JsonValue::Kind::string)) {
        report_kind("one of " + quoted_list(now));
        return std::nullopt;
    }
    if (const auto at = std::find(now.begin(), now.end(), value_->text); at != now.end())
        return static_cast<std::size_t>(at - now.begin());
    report(fmt::format("unknown value {}{}", shown_value(*value_), suggestion(value_->text, now)));
    return std::nullopt;
}

std::vector<ValueReader> ValueReader::items() const {
    if (!is(JsonValue::Kind::array)) {
        report_kind("a list [ ... ]");
        return {};
    }
    const ValueSchema* item = description_ != nullptr && description_->list ? description_->list->item.get() : nullptr;
    std::vector<ValueReader> result;
    result.reserve(value_->items.size());
    for (std::size_t i = 0; i < value_->items.size(); ++i)
        result.emplace_back(value_->items[i], child_pointer(pointer_, std::to_string(i)), *problems_, item);
    return result;
}

std::vector<std::pair<std::string, ValueReader>> ValueReader::members() const {
    if (!is(JsonValue::Kind::object)) {
        report_kind("an object { ... }");
        return {};
    }
    std::vector<std::pair<std::string, ValueReader>> result;
    result.reserve(value_->members.size());
    for (const JsonMember& member : value_->members) {
        const ValueSchema* described =
            description_ != nullptr && description_->object ? description_->object->value_of(member.key) : nullptr;
        result.emplace_back(member.key,
                            ValueReader(member.value, child_pointer(pointer_, member.key), *problems_, described));
    }
    return result;
}

ObjectReader::ObjectReader(const ValueReader& value) : self_(value), valid_(value.is(JsonValue::Kind::object)) {
    if (!valid_) value.report_kind("an object { ... }");
}

const ValueSchema* ObjectReader::description_of(std::string_view key) const {
    const ValueSchema* own = self_.description_;
    if (own == nullptr || own->anything) return nullptr;
    const ValueSchema* described = own->object ? own->object->value_of(key) : nullptr;
    if (described == nullptr)
        throw std::logic_error(fmt::format("the key {} is read and not described", child_pointer(self_.pointer_, key)));
    return described;
}

std::optional<ValueReader> ObjectReader::find(std::string_view key) {
    const ValueSchema* described = description_of(key);
    if (!is_in(key, known_)) known_.emplace_back(key);
    if (self_.refused()) return std::nullopt;
    for (const JsonMember& member : self_.value_->members) {
        if (member.key != key) continue;
        return ValueReader(member.value, child_pointer(self_.pointer_, key), *self_.problems_, described);
    }
    return std::nullopt;
}

std::optional<ValueReader> ObjectReader::require(std::string_view key, std::string_view meaning) {
    auto found = find(key);
    if (!found && valid_) self_.report(fmt::format("\"{}\" is missing: {}", key, meaning));
    return found;
}

void ObjectReader::finish() const {
    for (const JsonMember& member : self_.value_->members) {
        if (is_in(member.key, known_) || member.value.flaw == JsonValue::Flaw::itself) continue;
        const ValueSchema* own = self_.description_;
        if (own != nullptr && own->object != nullptr && own->object->find(member.key) != nullptr) {
            if (self_.problems_->empty())
                throw std::logic_error(
                    fmt::format("the key {} is described and not read", child_pointer(self_.pointer_, member.key)));
        } else {
            report(member.key, "unknown key" + suggestion(member.key, known_));
        }
    }
}

void ObjectReader::report(std::string_view key, std::string rule) const {
    Place place = self_.value_->place;
    for (const JsonMember& member : self_.value_->members)
        if (member.key == key) place = member.place;
    self_.problems_->push_back({place, child_pointer(self_.pointer_, key), std::move(rule), Problem::Kind::job});
}

}  // namespace orbid::apps
