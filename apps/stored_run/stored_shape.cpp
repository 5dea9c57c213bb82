#include "apps/stored_run/stored_shape.hpp"

#include <string>
#include <string_view>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

/// The file that is checked; what is wrong with it names its place.
struct CheckedFile {
    std::string name;

    void need(bool right, const std::string& pointer, std::string_view rule) const {
        if (!right)
            throw orbits::DataError(
                fmt::format("{}: {}: {}; the file was changed after it was stored", name, pointer, rule));
    }

    /// A member that must be a list.
    const Json& list(const Json& object, const std::string& pointer, const char* key) const {
        const auto found = object.find(key);
        need(found != object.end() && found->is_array(), pointer + "/" + key, "must be a list");
        return *found;
    }
};

/// The number of coordinates.
std::size_t checked_coordinates(const CheckedFile& file, const Json& json) {
    const Json& names = file.list(json, "", "coordinates");
    file.need(!names.empty(), "/coordinates", "must not be empty");
    for (std::size_t i = 0; i < names.size(); ++i)
        file.need(names[i].is_string(), fmt::format("/coordinates/{}", i), "must be a text");
    return names.size();
}

/// "period" and "points" of an orbit. One that was not computed has no points.
void check_points(const CheckedFile& file, const Json& orbit, const std::string& pointer, std::size_t dimension) {
    file.need(orbit.is_object(), pointer, "must be an object");
    // Far beyond any use; it guards the conversion to int.
    constexpr std::uint64_t longest = 1'000'000;
    const auto period = orbit.find("period");
    file.need(period != orbit.end() && period->is_number_unsigned() && period->get<std::uint64_t>() >= 1 &&
                  period->get<std::uint64_t>() <= longest,
              pointer + "/period", "must be a whole number from 1 to 1000000");
    const auto points = orbit.find("points");
    file.need(points != orbit.end(), pointer, "\"points\" is missing");
    if (points->is_null()) return;
    file.need(points->is_array() && points->size() == period->get<std::uint64_t>(), pointer + "/points",
              "must be a list of as many points as the period");
    for (std::size_t j = 0; j < points->size(); ++j) {
        const Json& point = (*points)[j];
        const std::string at = fmt::format("{}/points/{}", pointer, j);
        file.need(point.is_array() && point.size() == dimension, at, "must be a list of one number per coordinate");
        for (const Json& number : point)
            file.need(number.is_number() || number.is_null(), at, "must hold numbers");
    }
}

/// A member that is a square matrix of numbers, where it is there.
void check_square(const CheckedFile& file, const Json& object, const std::string& pointer, const char* key) {
    const auto matrix = object.find(key);
    if (matrix == object.end() || matrix->is_null()) return;
    const std::string at = fmt::format("{}/{}", pointer, key);
    file.need(matrix->is_array(), at, "must be a list of rows");
    for (const Json& row : *matrix) {
        file.need(row.is_array() && row.size() == matrix->size(), at, "must have as many columns as rows");
        for (const Json& number : row)
            file.need(number.is_number() || number.is_null(), at, "must hold numbers");
    }
}

}  // namespace

void check_cycle_list(const std::filesystem::path& path, const Json& json) {
    const CheckedFile file{path.string()};
    const std::size_t dimension = checked_coordinates(file, json);
    const Json& cycles = file.list(json, "", "cycles");
    for (std::size_t i = 0; i < cycles.size(); ++i) {
        const std::string pointer = fmt::format("/cycles/{}", i);
        check_points(file, cycles[i], pointer, dimension);
        check_square(file, cycles[i], pointer, "ln_multiplier_covariance");
        const auto mirror = cycles[i].find("mirror");
        if (mirror == cycles[i].end() || mirror->is_null()) continue;
        file.need(mirror->is_number_unsigned() && mirror->get<std::uint64_t>() < cycles.size(), pointer + "/mirror",
                  "must be the index of a cycle of this list");
    }
}

void check_branch_list(const std::filesystem::path& path, const Json& json) {
    const CheckedFile file{path.string()};
    const std::size_t dimension = checked_coordinates(file, json);
    const auto parameter = json.find("parameter");
    file.need(parameter != json.end() && parameter->is_object(), "/parameter", "must be an object");
    const Json& branches = file.list(json, "", "branches");
    for (std::size_t b = 0; b < branches.size(); ++b) {
        const std::string pointer = fmt::format("/branches/{}", b);
        file.need(branches[b].is_object(), pointer, "must be an object");
        const Json& points = file.list(branches[b], pointer, "points");
        for (std::size_t k = 0; k < points.size(); ++k)
            check_points(file, points[k], fmt::format("{}/points/{}", pointer, k), dimension);
    }
}

}  // namespace orbid::apps
