#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

/// Where something stands in a text file, counted from 1; columns in bytes. Line 0: the file as a whole.
struct Place {
    std::size_t line = 1;
    std::size_t column = 1;
};

/// A job needs about 8 levels; the limit keeps what follows a tree downwards from exhausting the stack.
inline constexpr std::size_t deepest_json = 64;

/// A value of JSON takes some 130 bytes here: the limit keeps a hostile text below 1 GB of memory.
inline constexpr std::size_t most_json_values = 4'000'000;

/// Longest text of a described value, as long as a formula may be.
inline constexpr std::size_t longest_json_text = 20'000;

struct JsonMember;

/// A JSON value with its place in the file.
struct JsonValue {
    enum class Kind { null, boolean, number, string, array, object };
    /// Problems that check_described() has already reported.
    enum class Flaw { none, within, itself };

    Kind kind = Kind::null;
    bool boolean = false;
    double number = 0.0;  ///< finite
    std::string text;
    bool escaped = false;  ///< a text written with escapes: its characters are not at the places of those of `text`
    std::vector<JsonValue> items;     ///< array
    std::vector<JsonMember> members;  ///< object, in the order of the file, keys unique
    Place place;
    Flaw flaw = Flaw::none;  ///< itself: readers take the value as absent
};

struct JsonMember {
    std::string key;
    Place place;  ///< of the key
    JsonValue value;
};

/// "a number", "a list", ...: the kind of a value, for messages.
[[nodiscard]] std::string_view description(JsonValue::Kind kind);

/// A problem of a job: where, and what would be right.
struct Problem {
    enum class Kind { job, data };  ///< data: a data file that cannot be read (exit code 3 instead of 2)

    Place place;
    std::string pointer;  ///< JSON Pointer (RFC 6901), empty = the whole document
    std::string rule;
    Kind kind = Kind::job;
};

/// "job.json:12:5: /estimate/parametres: unknown key; did you mean "parameters"?" Pointer and rule are cut where names
/// of a hostile document make them too long to be read.
[[nodiscard]] std::string message(const Problem& problem, std::string_view file);

/// The pointer of a member or item below `pointer`, with ~ and / in keys escaped.
[[nodiscard]] std::string child_pointer(std::string_view pointer, std::string_view key);

struct JsonDocument {
    std::optional<JsonValue> root;  ///< empty when the syntax is wrong
    std::vector<Problem> problems;  ///< the syntax error, or every duplicate key
};

/// Reads JSON with // and /* */ comments. Never throws for invalid text.
///
/// Refused: syntax errors (with what was expected), duplicate keys (with both lines; the first one is kept), numbers
/// beyond the range of double, text that is not UTF-8, an empty file, more than `deepest_json` levels of nesting, more
/// than `most_json_values` values.
[[nodiscard]] JsonDocument parse_json(std::string_view text);

/// Whether brackets of a text, outside of strings, are nested deeper than `deepest_json`. Whatever the text is.
[[nodiscard]] bool is_nested_too_deep(std::string_view text);

}  // namespace orbid::apps
