#include "apps/documents/json_document.hpp"

#include <algorithm>
#include <array>
#include <unordered_map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace orbid::apps {

namespace {

// Where the library takes a comment that begins with // to end.
constexpr std::string_view ends_of_comment("\n\r\0", 3);

constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";

/// Builds the tree. nlohmann's SAX events carry no positions, but they come in the order of the tokens, each already
/// checked: following the text token by token beside them tells where each one starts.
class Builder {
public:
    using Json = nlohmann::json;

    Builder(std::string_view text, JsonDocument& document) : text_(text), document_(document) {
        if (text_.substr(0, byte_order_mark.size()) == byte_order_mark) cursor_ = byte_order_mark.size();
        line_start_ = cursor_;
    }

    bool null() { return leaf(JsonValue::Kind::null); }
    bool boolean(bool value) {
        return leaf(JsonValue::Kind::boolean, [&](JsonValue& v) { v.boolean = value; });
    }
    bool number_integer(Json::number_integer_t value) { return number(static_cast<double>(value)); }
    bool number_unsigned(Json::number_unsigned_t value) { return number(static_cast<double>(value)); }
    bool number_float(Json::number_float_t value, const Json::string_t&) { return number(value); }
    bool string(Json::string_t& value) {
        return leaf(JsonValue::Kind::string, [&](JsonValue& v) {
            v.text = value;
            v.escaped = escaped_;
        });
    }
    bool binary(Json::binary_t&) { return false; }  // does not occur in text

    bool start_object(std::size_t) { return open(JsonValue::Kind::object); }
    bool start_array(std::size_t) { return open(JsonValue::Kind::array); }
    bool end_object() { return close(); }
    bool end_array() { return close(); }

    bool key(Json::string_t& name) {
        key_place_ = next_token();
        key_ = name;
        return true;
    }

    bool parse_error(std::size_t position, const std::string&, const nlohmann::detail::exception& error) {
        // what() = "[json.exception...] parse error at line 3, column 5: syntax error while ...": our own place is
        // printed in front, so only the last part is kept.
        std::string rule = error.what();
        if (const auto at = rule.find(": syntax error"); at != std::string::npos) {
            rule = rule.substr(at + 2);
        } else if (const auto bracket = rule.find("] "); bracket != std::string::npos) {
            rule = rule.substr(bracket + 2);
        }
        // position counts the bytes read, the last of which is the one that made no sense.
        // A number too large is a whole token, which starts where the next one is looked for.
        const bool number = dynamic_cast<const Json::out_of_range*>(&error) != nullptr;
        const auto says = [&](std::string_view text) { return rule.find(text) != std::string::npos; };
        if (number) rule += "; a number is at most 1.8e308";
        if (says("unexpected '}'") || says("unexpected ']'")) rule += "; remove the comma after the last entry";
        if (says("invalid literal")) rule += "; a text stands in quotes";
        const Place place = number ? next_token() : place_of(position > 0 ? position - 1 : 0);
        fail(place, rule);
        return false;
    }

private:
    bool number(double value) {
        return leaf(JsonValue::Kind::number, [&](JsonValue& v) { v.number = value; });
    }

    bool leaf(JsonValue::Kind kind) {
        return leaf(kind, [](JsonValue&) {});
    }
    template <class Fill>
    bool leaf(JsonValue::Kind kind, Fill fill) {
        JsonValue value;
        value.kind = kind;
        value.place = next_token();
        if (is_one_too_many(value.place)) return false;
        fill(value);
        add(std::move(value));
        return true;
    }

    bool open(JsonValue::Kind kind) {
        Level level;
        level.value.kind = kind;
        level.value.place = next_token();
        level.key = key_;
        level.key_place = key_place_;
        if (levels_.size() >= deepest_json) {
            fail(level.value.place, fmt::format("nested deeper than {} levels", deepest_json));
            return false;
        }
        if (is_one_too_many(level.value.place)) return false;
        levels_.push_back(std::move(level));
        return true;
    }

    bool is_one_too_many(Place place) {
        if (++count_ <= most_json_values) return false;
        fail(place, fmt::format("more than {} values", most_json_values));
        return true;
    }

    bool close() {
        next_token();
        Level level = std::move(levels_.back());
        levels_.pop_back();
        key_ = level.key;
        key_place_ = level.key_place;
        add(std::move(level.value));
        return true;
    }

    void add(JsonValue value) {
        if (levels_.empty()) {
            document_.root = std::move(value);
            return;
        }
        JsonValue& parent = levels_.back().value;
        if (parent.kind == JsonValue::Kind::array) {
            parent.items.push_back(std::move(value));
            return;
        }
        if (const JsonMember* same = member_of(levels_.back(), key_)) {
            document_.problems.push_back({key_place_, child_pointer(pointer(), key_),
                                          fmt::format("duplicate key, first given in line {}, column {}",
                                                      same->place.line, same->place.column)});
            return;
        }
        parent.members.push_back({key_, key_place_, std::move(value)});
    }

    struct Level {
        JsonValue value;
        std::string key;
        Place key_place;
        std::unordered_map<std::string, std::size_t> index;  ///< of members by key, where there are many
    };

    /// The member of this key; null when there is none yet.
    static const JsonMember* member_of(Level& level, const std::string& key) {
        constexpr std::size_t few = 32;  // a search from the first to the last is as fast
        const auto& members = level.value.members;
        if (members.size() < few) {
            const auto same =
                std::find_if(members.begin(), members.end(), [&](const JsonMember& one) { return one.key == key; });
            return same == members.end() ? nullptr : &*same;
        }
        for (std::size_t i = level.index.size(); i < members.size(); ++i)
            level.index.emplace(members[i].key, i);
        const auto found = level.index.find(key);
        return found == level.index.end() ? nullptr : &members[found->second];
    }

    /// Pointer of the innermost open level.
    std::string pointer() const {
        std::string result;
        for (std::size_t i = 1; i < levels_.size(); ++i) {
            const JsonValue& parent = levels_[i - 1].value;
            result = child_pointer(
                result, parent.kind == JsonValue::Kind::array ? std::to_string(parent.items.size()) : levels_[i].key);
        }
        return result;
    }

    void fail(Place place, std::string rule) {
        document_.root.reset();
        document_.problems.push_back({place, levels_.empty() ? "" : pointer(), std::move(rule)});
    }

    /// Steps over blanks, comments, commas and colons to the next token, then over that token; where it starts.
    Place next_token() {
        skip_to_token();
        const Place place{line_, cursor_ - line_start_ + 1};
        if (cursor_ >= text_.size()) return place;
        const char first = text_[cursor_];
        if (first == '"') {
            ++cursor_;
            escaped_ = false;
            while (cursor_ < text_.size() && text_[cursor_] != '"') {
                escaped_ = escaped_ || text_[cursor_] == '\\';
                cursor_ += text_[cursor_] == '\\' ? 2 : 1;
            }
            cursor_ = std::min(cursor_ + 1, text_.size());
        } else if (first == '{' || first == '}' || first == '[' || first == ']') {
            ++cursor_;
        } else {
            // A number or a literal: up to what cannot belong to it.
            constexpr std::string_view ends = " \t\r\n,:]}/";
            cursor_ = std::min(text_.find_first_of(ends, cursor_), text_.size());
        }
        return place;
    }

    void skip_to_token() {
        while (cursor_ < text_.size()) {
            const char c = text_[cursor_];
            if (c == '/' && cursor_ + 1 < text_.size()) {
                const bool line_comment = text_[cursor_ + 1] == '/';
                const std::size_t end =
                    line_comment ? text_.find_first_of(ends_of_comment, cursor_ + 2) : text_.find("*/", cursor_ + 2);
                const std::size_t stop = end == std::string_view::npos ? text_.size() : (line_comment ? end : end + 2);
                for (; cursor_ < stop; ++cursor_)
                    count_line();
            } else if (c == '\0' && cursor_ > 0) {
                ++cursor_;  // as the end of a comment; anywhere else the library has refused it
            } else if (c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == ',' || c == ':') {
                count_line();
                ++cursor_;
            } else {
                return;
            }
        }
    }

    void count_line() {
        if (text_[cursor_] != '\n') return;
        ++line_;
        line_start_ = cursor_ + 1;
    }

    Place place_of(std::size_t offset) const {
        offset = std::min(offset, text_.size());
        const std::string_view before = text_.substr(0, offset);
        const auto lines = static_cast<std::size_t>(std::count(before.begin(), before.end(), '\n'));
        const std::size_t last = before.rfind('\n');
        return {lines + 1, last == std::string_view::npos ? offset + 1 : offset - last};
    }

    std::string_view text_;
    JsonDocument& document_;
    std::size_t cursor_ = 0;
    std::size_t line_ = 1;
    std::size_t line_start_ = 0;
    std::size_t count_ = 0;  ///< values
    bool escaped_ = false;   ///< the last text token
    std::string key_;
    Place key_place_;
    std::vector<Level> levels_;
};

}  // namespace

std::string_view description(JsonValue::Kind kind) {
    constexpr std::array<std::string_view, 6> words{"null",   "true or false", "a number",
                                                    "a text", "a list",        "an object"};
    return words[static_cast<std::size_t>(kind)];
}

std::string message(const Problem& problem, std::string_view file) {
    const auto shown = [](std::string_view text, std::size_t longest) {
        return text.size() <= longest ? std::string(text) : fmt::format("{}...", text.substr(0, longest));
    };
    constexpr std::size_t longest_pointer = 300, longest_rule = 4000;
    // What is wrong with the file as a whole has no place in it.
    if (problem.place.line == 0) return fmt::format("{}: {}", file, shown(problem.rule, longest_rule));
    return fmt::format("{}:{}:{}: {}{}{}", file, problem.place.line, problem.place.column,
                       shown(problem.pointer, longest_pointer), problem.pointer.empty() ? "" : ": ",
                       shown(problem.rule, longest_rule));
}

std::string child_pointer(std::string_view pointer, std::string_view key) {
    std::string result(pointer);
    result += '/';
    for (const char c : key) {
        if (c == '~') {
            result += "~0";
        } else if (c == '/') {
            result += "~1";
        } else {
            result += c;
        }
    }
    return result;
}

bool is_nested_too_deep(std::string_view text) {
    std::size_t depth = 0;
    bool inside = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (inside) {
            if (c == '\\') ++i;
            inside = c != '"';
        } else if (c == '"') {
            inside = true;
        } else if (c == '/' && i + 1 < text.size() && (text[i + 1] == '/' || text[i + 1] == '*')) {
            const bool line = text[i + 1] == '/';
            const std::size_t end = line ? text.find_first_of(ends_of_comment, i + 2) : text.find("*/", i + 2);
            if (end == std::string_view::npos) return false;
            i = line ? end : end + 1;
        } else if (c == '{' || c == '[') {
            if (++depth > deepest_json) return true;
        } else if ((c == '}' || c == ']') && depth > 0) {
            --depth;
        }
    }
    return false;
}

JsonDocument parse_json(std::string_view text) {
    JsonDocument document;
    if (text.find_first_not_of(" \t\r\n") == std::string_view::npos) {
        document.problems.push_back({{}, "", "the file is empty; it must hold an object { ... }"});
        return document;
    }
    Builder builder(text, document);
    const bool strict = true;
    const bool ignore_comments = true;
    if (!nlohmann::json::sax_parse(text.begin(), text.end(), &builder, nlohmann::json::input_format_t::json, strict,
                                   ignore_comments)) {
        document.root.reset();
    }
    return document;
}

}  // namespace orbid::apps
