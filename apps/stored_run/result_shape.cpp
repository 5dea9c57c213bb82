#include <string>
#include <string_view>

#include <fmt/format.h>

#include "apps/stored_run/stored_shape.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

enum class Kind { text, number, count, truth, object, list, interval, texts };

/// What stands at a place: below every member or entry where the place says "*".
struct Place {
    std::string_view pointer;
    Kind kind;
    bool null = false;  ///< may be null
};

constexpr Place places[] = {
    {"/status", Kind::text},
    {"/message", Kind::text},
    {"/verdict", Kind::object},
    {"/verdict/trust", Kind::text},
    {"/verdict/line", Kind::text},
    {"/verdict/because", Kind::texts},
    {"/parameters", Kind::object},
    {"/derived", Kind::object},
    {"/parameters/*", Kind::object},
    {"/derived/*", Kind::object},
    {"/parameters/*/value", Kind::number, true},
    {"/parameters/*/sd", Kind::number, true},
    {"/parameters/*/interval95", Kind::interval, true},
    {"/parameters/*/interval_method", Kind::text},
    {"/parameters/*/one_sided", Kind::text, true},
    {"/parameters/*/start", Kind::number, true},
    {"/parameters/*/reference", Kind::number, true},
    {"/parameters/*/unit", Kind::text},
    {"/parameters/*/at_bound", Kind::text, true},
    {"/derived/*/value", Kind::number, true},
    {"/derived/*/sd", Kind::number, true},
    {"/derived/*/interval95", Kind::interval, true},
    {"/derived/*/unit", Kind::text},
    {"/errors", Kind::object},
    {"/errors/*", Kind::object},
    {"/errors/*/sd", Kind::number, true},
    {"/errors/*/factor", Kind::number, true},
    {"/errors/*/unit", Kind::text},
    {"/errors/*/count", Kind::count},
    {"/errors/*/estimated", Kind::truth},
    {"/errors/*/rms", Kind::number, true},
    {"/errors/*/distribution", Kind::text},
    {"/errors/*/interval95", Kind::interval, true},
    {"/covariances", Kind::list},
    {"/covariances/*", Kind::object},
    {"/covariances/*/groups", Kind::texts},
    {"/covariances/*/matrix", Kind::list},
    {"/covariances/*/uncertainty", Kind::list},
    {"/initial_states", Kind::list},
    {"/initial_states/*", Kind::object},
    {"/initial_states/*/experiment", Kind::text},
    {"/initial_states/*/segment", Kind::text},
    {"/initial_states/*/state", Kind::object},
    {"/initial_states/*/state/*", Kind::object},
    {"/prediction", Kind::list},
    {"/prediction/*", Kind::object},
    {"/prediction/*/experiment", Kind::text},
    {"/prediction/*/segment", Kind::text},
    {"/prediction/*/rms", Kind::object},
    {"/prediction/*/fitted", Kind::truth},
    {"/identifiability", Kind::object},
    {"/identifiability/singular_values", Kind::list},
    {"/identifiability/sloppy_directions", Kind::list},
    {"/identifiability/trust_normal", Kind::truth},
    {"/residuals", Kind::list},
    {"/residuals/*", Kind::object},
    {"/residuals/*/type", Kind::text},
    {"/objective", Kind::number, true},
    {"/degrees_of_freedom", Kind::number, true},
    {"/iterations", Kind::count},
    {"/posterior", Kind::object, true},
    {"/profile", Kind::object, true},
    {"/profile/*", Kind::object},
    {"/profile/*/known", Kind::truth},
    {"/profile/*/points", Kind::list},
    {"/profile/*/points/*", Kind::object},
    {"/marginals", Kind::object, true},
    {"/diagnostics", Kind::object, true},
    {"/diagnostics/*", Kind::object, true},
    {"/orbits", Kind::object},
    {"/data", Kind::object},
    {"/history", Kind::list},
    {"/history/*", Kind::object},
    {"/history/*/block", Kind::text},
    {"/history/*/accepted", Kind::truth},
};

bool is_interval(const Json& json) {
    if (!json.is_array() || json.size() != 2) return false;
    for (const Json& end : json)
        if (!end.is_number() && !end.is_null()) return false;
    return true;
}

bool are_texts(const Json& json) {
    if (!json.is_array()) return false;
    for (const Json& one : json)
        if (!one.is_string()) return false;
    return true;
}

/// What a value of that kind must be; empty: it is.
std::string_view rule_broken(Kind kind, const Json& json) {
    switch (kind) {
        case Kind::text:
            return json.is_string() ? "" : "must be a text";
        case Kind::number:
            return json.is_number() ? "" : "must be a number";
        case Kind::count:
            return json.is_number_unsigned() ? "" : "must be a whole number from 0 on";
        case Kind::truth:
            return json.is_boolean() ? "" : "must be true or false";
        case Kind::object:
            return json.is_object() ? "" : "must be an object";
        case Kind::list:
            return json.is_array() ? "" : "must be a list";
        case Kind::interval:
            return is_interval(json) ? "" : "must be a list of two numbers";
        case Kind::texts:
            return are_texts(json) ? "" : "must be a list of texts";
    }
    return "";
}

class CheckedResult {
public:
    explicit CheckedResult(const std::filesystem::path& file) : file_(file.string()) {}

    [[noreturn]] void refuse(const std::string& pointer, std::string_view rule) const {
        throw orbits::DataError(
            fmt::format("{}: {}: {}; the file was changed after it was stored", file_, pointer, rule));
    }

    /// @param rest  what of the place is below `json`: "/*/unit"
    void check(const Json& json, std::string_view rest, const std::string& pointer, const Place& place) const {
        if (rest.empty()) {
            if (place.null && json.is_null()) return;
            if (const auto rule = rule_broken(place.kind, json); !rule.empty()) refuse(pointer, rule);
            return;
        }
        const std::string_view key = rest.substr(1, rest.find('/', 1) - 1);
        const std::string_view below = rest.substr(1 + key.size());
        if (json.is_array() && key == "*") {
            for (std::size_t i = 0; i < json.size(); ++i)
                check(json[i], below, fmt::format("{}/{}", pointer, i), place);
        } else if (json.is_object()) {
            for (const auto& [name, value] : json.items())
                if (key == "*" || key == name) check(value, below, fmt::format("{}/{}", pointer, name), place);
        }
    }

    /// A square matrix with a name for each row; of older or unfinished results it may be absent or empty.
    void check_matrix(const Json& result, const std::string& key) const {
        const auto found = result.find(key);
        if (found == result.end() || found->is_null()) return;
        const std::string pointer = "/" + key;
        if (!found->is_object() || !found->contains("names") || !found->contains("matrix"))
            refuse(pointer, "must be an object with \"names\" and \"matrix\"");
        const Json& names = (*found)["names"];
        const Json& matrix = (*found)["matrix"];
        if (!are_texts(names)) refuse(pointer + "/names", "must be a list of texts");
        if (!matrix.is_array() || (!matrix.empty() && matrix.size() != names.size()))
            refuse(pointer + "/matrix", "must have a row for each name");
        for (std::size_t i = 0; i < matrix.size(); ++i) {
            const std::string row = fmt::format("{}/matrix/{}", pointer, i);
            if (!matrix[i].is_array() || matrix[i].size() != names.size()) refuse(row, "must have a number for each name");
            for (const Json& number : matrix[i])
                if (!number.is_number() && !number.is_null()) refuse(row, "must hold numbers");
        }
    }

private:
    std::string file_;
};

}  // namespace

void check_result(const std::filesystem::path& file, const StoredRun::Json& json) {
    const CheckedResult result(file);
    for (const char* needed : {"status", "parameters"})
        if (!json.contains(needed)) result.refuse("/", fmt::format("\"{}\" is missing", needed));
    for (const Place& place : places)
        result.check(json, place.pointer, "", place);
    for (const char* key : {"correlation", "covariance"})
        result.check_matrix(json, key);
}

}  // namespace orbid::apps
