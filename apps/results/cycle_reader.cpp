#include "apps/results/cycle_reader.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_reader.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {
namespace {

constexpr std::uint64_t longest_period = 1'000'000;             // far beyond any use: only guards the conversion to int
constexpr std::uint64_t most_counted = std::uint64_t{1} << 53;  // what a JSON number holds exactly

/// A key that holds something: null is as good as absent in a file of results.
std::optional<ValueReader> given(ObjectReader& object, std::string_view key) {
    auto found = object.find(key);
    return found && !found->is(JsonValue::Kind::null) ? found : std::nullopt;
}

/// A count; 0 without it.
std::size_t count_of(ObjectReader& object, std::string_view key) {
    const auto value = given(object, key);
    return static_cast<std::size_t>(value ? value->whole(0, most_counted).value_or(0) : 0);
}

/// A number, or nan for null (undefined).
double number_or_nan(const ValueReader& value) {
    return value.is(JsonValue::Kind::null) ? std::numeric_limits<double>::quiet_NaN() : value.number().value_or(0.0);
}

/// Shape (size), nan for null; empty after a problem was reported.
Eigen::VectorXd numbers(const ValueReader& value, Eigen::Index size) {
    const auto items = value.items();
    if (std::ssize(items) != size) {
        if (value.is(JsonValue::Kind::array))
            value.report(fmt::format("has {} numbers, must have {}", items.size(), size));
        return {};
    }
    Eigen::VectorXd out(size);
    for (Eigen::Index i = 0; i < size; ++i)
        out[i] = number_or_nan(items[static_cast<std::size_t>(i)]);
    return out;
}

/// Shape (rows, columns) from a list of rows; empty after a problem was reported.
Eigen::MatrixXd matrix(const ValueReader& value, Eigen::Index rows, Eigen::Index columns) {
    if (!value.is(JsonValue::Kind::array)) {
        value.report_kind(fmt::format("a list of {} rows", rows));
        return {};
    }
    const auto lines = value.items();
    if (static_cast<Eigen::Index>(lines.size()) != rows) {
        value.report(fmt::format("has {} rows, must have {}", lines.size(), rows));
        return {};
    }
    Eigen::MatrixXd out(rows, columns);
    for (Eigen::Index i = 0; i < rows; ++i) {
        const Eigen::VectorXd line = numbers(lines[static_cast<std::size_t>(i)], columns);
        if (line.size() != columns) return {};
        out.row(i) = line.transpose();
    }
    return out;
}

/// Points of a cycle, shape (n, p): one row of the file per point.
Eigen::MatrixXd points_of(const ValueReader& value, int period,
                          const std::vector<orbits::SeriesCoordinate>& coordinates) {
    if (value.is(JsonValue::Kind::array) && value.value().items.size() != static_cast<std::size_t>(period)) {
        value.report(
            fmt::format("has {} points, must have as many as the period, {}", value.value().items.size(), period));
        return {};
    }
    Eigen::MatrixXd points = matrix(value, period, static_cast<Eigen::Index>(coordinates.size())).transpose();
    if (points.size() > 0 && !points.allFinite()) {
        value.report("holds null, must hold numbers");
        return {};
    }
    // As of readings: sums of squares must not overflow.
    constexpr double most = 1e100;
    if (points.size() > 0 && points.cwiseAbs().maxCoeff() > most) {
        value.report(
            fmt::format("holds {:.3g}, must lie within 1e100: use another unit", points.cwiseAbs().maxCoeff()));
        return {};
    }
    for (Eigen::Index i = 0; i < points.rows(); ++i) {
        for (Eigen::Index k = 0; coordinates[static_cast<std::size_t>(i)].angle && k < points.cols(); ++k)
            points(i, k) = models::wrapped(points(i, k));
    }
    return points;
}

/// Symmetric to the last digits a program may print, and then made so; with variances that are variances. What is off
/// by rounding stays as it is: a run that takes up its own cycles gives the same bytes.
Eigen::MatrixXd covariance_of(const ValueReader& value, Eigen::Index size) {
    Eigen::MatrixXd out = matrix(value, size, size);
    constexpr double digits = 1e-6;
    for (Eigen::Index i = 0; i < out.rows(); ++i) {
        if (!(out(i, i) > 0.0)) {
            value.report(fmt::format("element {}, {} is {}, must be > 0: it is a variance", i, i, out(i, i)));
            return {};
        }
        for (Eigen::Index j = 0; j < i; ++j) {
            if (!(std::abs(out(i, j) - out(j, i)) <= digits * std::sqrt(out(i, i) * out(j, j)))) {
                value.report(fmt::format("elements {}, {} and {}, {} differ ({}, {}), must be symmetric", i, j, j, i,
                                         out(i, j), out(j, i)));
                return {};
            }
        }
    }
    constexpr double rounding = 1e-12;
    if (out.size() > 0 && (out - out.transpose()).cwiseAbs().maxCoeff() > rounding * out.diagonal().maxCoeff())
        out = 0.5 * (out + out.transpose()).eval();
    return out;
}

std::vector<std::string> texts(const ValueReader& value) {
    std::vector<std::string> out;
    for (const ValueReader& item : value.items())
        out.push_back(item.text().value_or(""));
    return out;
}

std::optional<Fingerprint> fingerprint_of(const JsonValue& value) {
    Fingerprint stored;
    for (const JsonMember& member : value.members) {
        if (member.key == "sha256") {
            stored.sha256 = member.value.text;
        } else if (member.key == "keys") {
            for (const JsonValue& pair : member.value.items)
                if (pair.items.size() == 2) stored.keys.emplace_back(pair.items[0].text, pair.items[1].text);
        }
    }
    return fingerprint_from_text(to_text(stored));
}

void read_rotation(const ValueReader& value, const std::vector<orbits::SeriesCoordinate>& coordinates,
                   std::vector<int>& rotation) {
    std::size_t angles = 0;
    for (const auto& coordinate : coordinates)
        angles += coordinate.angle ? 1 : 0;
    const auto items = value.items();
    if (value.is(JsonValue::Kind::array) && items.size() != angles) {
        value.report(fmt::format("has {} numbers of turns, must have {}, one per angle", items.size(), angles));
        return;
    }
    for (const ValueReader& item : items) {
        // As for periods: the bound only guards the conversion.
        const auto turns = item.number(
            [](double x) { return std::trunc(x) == x && std::abs(x) <= static_cast<double>(longest_period); },
            "a whole number");
        rotation.push_back(static_cast<int>(turns.value_or(0.0)));
    }
}

orbits::Cycle read_cycle(const ValueReader& value, const std::vector<orbits::SeriesCoordinate>& coordinates,
                         std::size_t count, bool& converged) {
    orbits::Cycle cycle;
    ObjectReader object(value);
    const auto period = object.require("period", "the number of sections after which the cycle closes");
    const auto points = object.require("points", "one list of coordinates per section");
    if (period) cycle.period = static_cast<int>(period->whole(1, longest_period).value_or(0));
    const auto n = static_cast<Eigen::Index>(coordinates.size());
    if (points && cycle.period > 0) cycle.points = points_of(*points, cycle.period, coordinates);
    if (const auto rotation = given(object, "rotation")) read_rotation(*rotation, coordinates, cycle.rotation);
    if (const auto covariance = given(object, "covariance"); covariance && cycle.points.size() > 0)
        cycle.covariance = covariance_of(*covariance, n * cycle.period);
    if (const auto multipliers = given(object, "multipliers")) {
        const Eigen::MatrixXd pairs =
            matrix(*multipliers, static_cast<Eigen::Index>(multipliers->value().items.size()), 2);
        for (Eigen::Index i = 0; i < pairs.rows(); ++i)
            cycle.multipliers.emplace_back(pairs(i, 0), pairs(i, 1));
    }
    if (const auto logarithms = given(object, "ln_multiplier")) {
        const auto items = logarithms->items();
        cycle.ln_multiplier.resize(static_cast<Eigen::Index>(items.size()));
        for (std::size_t i = 0; i < items.size(); ++i)
            cycle.ln_multiplier[static_cast<Eigen::Index>(i)] = number_or_nan(items[i]);
    }
    if (const auto covariance = given(object, "ln_multiplier_covariance"))
        cycle.ln_multiplier_covariance = matrix(*covariance, cycle.ln_multiplier.size(), cycle.ln_multiplier.size());
    if (const auto common = given(object, "common_errors"); common && cycle.points.size() > 0) {
        const auto rows = common->items();
        const auto columns = rows.empty() ? 0 : static_cast<Eigen::Index>(rows.front().value().items.size());
        // The last row, of the time, may be missing.
        const Eigen::Index least = cycle.points.size() + cycle.ln_multiplier.size();
        cycle.common = matrix(*common, std::ssize(rows) == least + 1 ? least + 1 : least, columns);
        if (!cycle.common.allFinite()) common->report("holds null, must hold numbers");
    }
    cycle.recurrences = count_of(object, "recurrences");
    if (const auto mirror = given(object, "mirror")) {
        if (const auto index = mirror->whole(0, count - 1)) cycle.mirror = static_cast<std::size_t>(*index);
    }
    if (const auto quality = given(object, "quality")) cycle.quality = texts(*quality);
    if (const auto time = given(object, "time")) cycle.time = number_or_nan(*time);
    if (const auto sd = given(object, "time_sd")) cycle.time_sd = number_or_nan(*sd);
    if (const auto covariance = given(object, "time_covariance"); covariance && cycle.points.size() > 0) {
        cycle.time_covariance = numbers(*covariance, cycle.points.size());
        if (!cycle.time_covariance.allFinite()) covariance->report("holds null, must hold numbers");
    }
    if (const auto code = given(object, "code")) cycle.code = code->text().value_or("");
    // These belong to computed orbits. One that did not converge is no cycle.
    if (const auto status = given(object, "status")) converged = status->text().value_or("") == "converged";
    for (const char* key : {"residual", "message", "iterations", "distance", "sensitivities", "time_sensitivities",
                            "times", "trivial_multiplier", "discretisation_error", "origin", "hits", "unstable",
                            "bifurcation_near", "directions", "ln_multiplier_sensitivities"}) {
        (void)object.find(key);
    }
    object.finish();
    return cycle;
}

/// A list of names (coordinates, units) that must be those expected.
void require_names(ObjectReader& object, std::string_view key, std::string_view model,
                   const std::vector<orbits::SeriesCoordinate>& coordinates,
                   std::string orbits::SeriesCoordinate::*name) {
    const auto value = given(object, key);
    if (!value) return;
    std::vector<std::string> expected;
    for (const auto& coordinate : coordinates)
        expected.push_back(coordinate.*name);
    if (texts(*value) != expected)
        value->report(fmt::format("must be [{}], as {} has them", quoted_list(expected), model));
}

void read_plane(ObjectReader& members, CycleFileHead& head) {
    const auto coordinate = given(members, "coordinate");
    const auto value = given(members, "value");
    const auto direction = given(members, "direction");
    if (!coordinate || !value || !direction) return;
    head.plane = SectionPlane{coordinate->text().value_or(""), value->number().value_or(0.0),
                              direction->number().value_or(1.0) < 0.0 ? -1 : 1};
}

void read_head(ObjectReader& object, std::string_view model, const std::vector<orbits::SeriesCoordinate>& coordinates,
               CycleFileHead& head) {
    if (const auto format = given(object, "format")) (void)format->choice({"orbid-cycles/1"});
    if (const auto name = given(object, "model"); name && name->text() && *name->text() != model)
        name->report(fmt::format("holds cycles of \"{}\", must be of \"{}\"", *name->text(), model));
    head.model = model;
    head.coordinates = coordinates;
    require_names(object, "coordinates", model, coordinates, &orbits::SeriesCoordinate::name);
    require_names(object, "units", model, coordinates, &orbits::SeriesCoordinate::unit);
    if (const auto section = given(object, "section")) {
        ObjectReader members(*section);
        if (const auto phase = given(members, "phase")) head.phase = phase->number();
        read_plane(members, head);
        members.finish();
    }
    if (const auto fingerprint = given(object, "fingerprint"))
        head.fingerprint = fingerprint_of(fingerprint->value()).value_or(Fingerprint{});
}

/// What the search said of itself beside the cycles.
void read_search(ObjectReader& object, std::size_t dimension, orbits::CycleSearch& search) {
    if (const auto missing = given(object, "missing")) {
        for (const ValueReader& item : missing->items())
            search.missing.push_back(static_cast<int>(item.whole(1, longest_period).value_or(1)));
    }
    search.candidates = count_of(object, "candidates");
    search.rejected = count_of(object, "rejected");
    if (const auto map = given(object, "patch_map")) search.spline_map = map->boolean().value_or(false);
    if (const auto covariance = given(object, "reading_covariance")) {
        const auto n = static_cast<Eigen::Index>(dimension);
        search.reading_covariance = matrix(*covariance, n, n);
    }
    if (const auto remarks = given(object, "remarks")) search.remarks = texts(*remarks);
}

}  // namespace

CycleReading parse_cycles(std::string_view text, std::string_view model,
                          const std::vector<orbits::SeriesCoordinate>& coordinates) {
    JsonDocument document = parse_json(text);
    CycleReading reading{std::nullopt, std::move(document.problems)};
    if (!document.root) return reading;
    CycleFile file;
    ObjectReader object(ValueReader(*document.root, "", reading.problems));
    read_head(object, model, coordinates, file.head);
    read_search(object, coordinates.size(), file.search);
    // Of orbits.json: what the columns of sensitivities are, and what a search says of itself.
    (void)object.find("parameters");
    (void)object.find("search");
    if (const auto cycles = object.require("cycles", "a list of cycles, each with period and points")) {
        const auto items = cycles->items();
        std::vector<std::optional<std::size_t>> place(items.size());  // of each entry among those that are kept
        for (std::size_t i = 0; i < items.size(); ++i) {
            bool converged = true;
            orbits::Cycle cycle = read_cycle(items[i], coordinates, items.size(), converged);
            if (!converged) continue;
            place[i] = file.search.cycles.size();
            file.search.cycles.push_back(std::move(cycle));
        }
        for (orbits::Cycle& cycle : file.search.cycles)
            if (cycle.mirror) cycle.mirror = place[*cycle.mirror];
    }
    object.finish();
    if (reading.problems.empty()) reading.file = std::move(file);
    return reading;
}

CycleFile read_cycles(const std::filesystem::path& path, std::string_view model,
                      const std::vector<orbits::SeriesCoordinate>& coordinates) {
    std::string text;
    try {
        text = read_whole_file(path);
    } catch (const std::runtime_error& error) {
        throw orbits::DataError(error.what());
    }
    CycleReading reading = parse_cycles(text, model, coordinates);
    if (!reading.file) {
        std::string lines;
        for (const Problem& problem : reading.problems)
            lines += fmt::format("{}{}", lines.empty() ? "" : "\n", message(problem, path.string()));
        throw orbits::DataError(lines);
    }
    return std::move(*reading.file);
}

}  // namespace orbid::apps
