#include <string>
#include <string_view>

#include <fmt/format.h>

#include "apps/stored_run/stored_shape.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

enum class ResultKind { text, number, count, truth, object, list, interval, texts };

/// What stands at a place: below every member or entry where the place says "*".
struct ResultPlace {
    std::string_view pointer;
    ResultKind kind;
    bool null = false;  ///< may be null
};

constexpr ResultPlace result_places[] = {
    {"/status", ResultKind::text},
    {"/message", ResultKind::text},
    {"/verdict", ResultKind::object},
    {"/verdict/trust", ResultKind::text},
    {"/verdict/line", ResultKind::text},
    {"/verdict/because", ResultKind::texts},
    {"/parameters", ResultKind::object},
    {"/derived", ResultKind::object},
    {"/parameters/*", ResultKind::object},
    {"/derived/*", ResultKind::object},
    {"/parameters/*/value", ResultKind::number, true},
    {"/parameters/*/sd", ResultKind::number, true},
    {"/parameters/*/interval95", ResultKind::interval, true},
    {"/parameters/*/interval_method", ResultKind::text},
    {"/parameters/*/one_sided", ResultKind::text, true},
    {"/parameters/*/start", ResultKind::number, true},
    {"/parameters/*/reference", ResultKind::number, true},
    {"/parameters/*/unit", ResultKind::text},
    {"/parameters/*/at_bound", ResultKind::text, true},
    {"/derived/*/value", ResultKind::number, true},
    {"/derived/*/sd", ResultKind::number, true},
    {"/derived/*/interval95", ResultKind::interval, true},
    {"/derived/*/unit", ResultKind::text},
    {"/errors", ResultKind::object},
    {"/errors/*", ResultKind::object},
    {"/errors/*/sd", ResultKind::number, true},
    {"/errors/*/factor", ResultKind::number, true},
    {"/errors/*/unit", ResultKind::text},
    {"/errors/*/count", ResultKind::count},
    {"/errors/*/estimated", ResultKind::truth},
    {"/errors/*/rms", ResultKind::number, true},
    {"/errors/*/distribution", ResultKind::text},
    {"/errors/*/interval95", ResultKind::interval, true},
    {"/covariances", ResultKind::list},
    {"/covariances/*", ResultKind::object},
    {"/covariances/*/groups", ResultKind::texts},
    {"/covariances/*/matrix", ResultKind::list},
    {"/covariances/*/uncertainty", ResultKind::list},
    {"/initial_states", ResultKind::list},
    {"/initial_states/*", ResultKind::object},
    {"/initial_states/*/experiment", ResultKind::text},
    {"/initial_states/*/segment", ResultKind::text},
    {"/initial_states/*/state", ResultKind::object},
    {"/initial_states/*/state/*", ResultKind::object},
    {"/prediction", ResultKind::list},
    {"/prediction/*", ResultKind::object},
    {"/prediction/*/experiment", ResultKind::text},
    {"/prediction/*/segment", ResultKind::text},
    {"/prediction/*/rms", ResultKind::object},
    {"/prediction/*/fitted", ResultKind::truth},
    {"/identifiability", ResultKind::object},
    {"/identifiability/singular_values", ResultKind::list},
    {"/identifiability/sloppy_directions", ResultKind::list},
    {"/identifiability/trust_normal", ResultKind::truth},
    {"/residuals", ResultKind::list},
    {"/residuals/*", ResultKind::object},
    {"/residuals/*/type", ResultKind::text},
    {"/objective", ResultKind::number, true},
    {"/degrees_of_freedom", ResultKind::number, true},
    {"/iterations", ResultKind::count},
    {"/posterior", ResultKind::object, true},
    {"/profile", ResultKind::object, true},
    {"/profile/*", ResultKind::object},
    {"/profile/*/known", ResultKind::truth},
    {"/profile/*/points", ResultKind::list},
    {"/profile/*/points/*", ResultKind::object},
    {"/marginals", ResultKind::object, true},
    {"/diagnostics", ResultKind::object, true},
    {"/diagnostics/*", ResultKind::object, true},
    {"/orbits", ResultKind::object},
    {"/data", ResultKind::object},
    {"/history", ResultKind::list},
    {"/history/*", ResultKind::object},
    {"/history/*/block", ResultKind::text},
    {"/history/*/accepted", ResultKind::truth},
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
std::string_view rule_broken(ResultKind kind, const Json& json) {
    switch (kind) {
        case ResultKind::text:
            return json.is_string() ? "" : "must be a text";
        case ResultKind::number:
            return json.is_number() ? "" : "must be a number";
        case ResultKind::count:
            return json.is_number_unsigned() ? "" : "must be a whole number from 0 on";
        case ResultKind::truth:
            return json.is_boolean() ? "" : "must be true or false";
        case ResultKind::object:
            return json.is_object() ? "" : "must be an object";
        case ResultKind::list:
            return json.is_array() ? "" : "must be a list";
        case ResultKind::interval:
            return is_interval(json) ? "" : "must be a list of two numbers";
        case ResultKind::texts:
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
    void check(const Json& json, std::string_view rest, const std::string& pointer, const ResultPlace& place) const {
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
            if (!matrix[i].is_array() || matrix[i].size() != names.size())
                refuse(row, "must have a number for each name");
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
    for (const ResultPlace& place : result_places)
        result.check(json, place.pointer, "", place);
    for (const char* key : {"correlation", "covariance"})
        result.check_matrix(json, key);
}

}  // namespace orbid::apps
