#include "apps/results/cycle_file.hpp"

#include <cmath>
#include <complex>
#include <stdexcept>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/json_text.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

}  // namespace

std::vector<orbits::SeriesCoordinate> series_coordinates(const models::System& system) {
    std::vector<orbits::SeriesCoordinate> coordinates;
    for (const auto& coordinate : system.coordinates())
        coordinates.push_back({std::string(coordinate.name), std::string(coordinate.unit), coordinate.angle});
    return coordinates;
}

namespace detail {

Json rows_or_null(const Eigen::MatrixXd& matrix) {
    return matrix.size() == 0 ? Json(nullptr) : json_rows(matrix);
}

Json complex_pair(std::complex<double> value) {
    return Json::array({value.real(), value.imag()});
}

Json complex_pairs(const std::vector<std::complex<double>>& values) {
    return json_list(values, complex_pair);
}

void require_points(const Eigen::MatrixXd& points, int period, std::size_t dimension, std::size_t index) {
    const auto n = static_cast<Eigen::Index>(dimension);
    if (period < 1 || points.rows() != n || points.cols() != period)
        throw std::invalid_argument(
            fmt::format("cycle {}: points have shape ({}, {}), must be (coordinates, period) = "
                        "({}, {}) with period >= 1",
                        index, points.rows(), points.cols(), n, period));
}

void require_shape(const Eigen::MatrixXd& matrix, Eigen::Index height, Eigen::Index width, std::string_view what,
                   std::size_t index) {
    if (matrix.size() != 0 && (matrix.rows() != height || matrix.cols() != width))
        throw std::invalid_argument(fmt::format("cycle {}: {} has shape ({}, {}), must be ({}, {})", index, what,
                                                matrix.rows(), matrix.cols(), height, width));
}

Json head_document(const CycleFileHead& head) {
    Json out;
    out["format"] = "orbid-cycles/1";
    out["model"] = head.model;
    out["coordinates"] = json_list(head.coordinates, &orbits::SeriesCoordinate::name);
    out["units"] = json_list(head.coordinates, &orbits::SeriesCoordinate::unit);
    out["section"] = Json::object();
    if (head.phase) out["section"]["phase"] = *head.phase;
    if (head.plane) {
        out["section"] = {
            {"coordinate", head.plane->coordinate}, {"value", head.plane->value}, {"direction", head.plane->direction}};
    }
    if (!head.fingerprint.sha256.empty()) out["fingerprint"] = Json::parse(to_text(head.fingerprint));
    return out;
}

Json time_of(const CycleFileHead& head, int period) {
    return head.forcing_period_s ? Json(period * *head.forcing_period_s) : Json(nullptr);
}

}  // namespace detail

namespace {

using detail::complex_pairs;
using detail::require_points;
using detail::require_shape;

Json cycle_json(const CycleFileHead& head, const orbits::Cycle& cycle, std::size_t index) {
    const auto n = static_cast<Eigen::Index>(head.coordinates.size());
    require_points(cycle.points, cycle.period, head.coordinates.size(), index);
    require_shape(cycle.covariance, n * cycle.period, n * cycle.period, "covariance", index);
    require_shape(cycle.time_covariance, n * cycle.period, 1, "time_covariance", index);
    Json out;
    out["period"] = cycle.period;
    // Angles read modulo a turn cannot tell how often the cycle went round.
    out["rotation"] = json_or_null(cycle.rotation);
    out["points"] = detail::rows_or_null(cycle.points.transpose());
    out["covariance"] = detail::rows_or_null(cycle.covariance);
    out["multipliers"] = complex_pairs(cycle.multipliers);
    out["ln_multiplier"] = json_list(cycle.ln_multiplier);
    out["ln_multiplier_covariance"] = detail::rows_or_null(cycle.ln_multiplier_covariance);
    out["common_errors"] = detail::rows_or_null(cycle.common);
    out["time"] = std::isfinite(cycle.time) ? Json(cycle.time) : detail::time_of(head, cycle.period);
    out["time_sd"] = cycle.time_sd;
    out["time_covariance"] = cycle.time_covariance.size() == 0 ? Json(nullptr) : json_list(cycle.time_covariance);
    out["code"] = json_or_null(cycle.code);
    out["recurrences"] = cycle.recurrences;
    out["mirror"] = json_or_null(cycle.mirror);
    out["quality"] = cycle.quality;
    return out;
}

}  // namespace

std::string cycles_text(const CycleFile& file) {
    Json out = detail::head_document(file.head);
    out["missing"] = file.search.missing;
    out["candidates"] = file.search.candidates;
    out["rejected"] = file.search.rejected;
    out["patch_map"] = file.search.spline_map;
    out["reading_covariance"] = detail::rows_or_null(file.search.reading_covariance);
    out["remarks"] = file.search.remarks;
    out["cycles"] = Json::array();
    for (std::size_t i = 0; i < file.search.cycles.size(); ++i)
        out["cycles"].push_back(cycle_json(file.head, file.search.cycles[i], i));
    return json_text(out);
}

}  // namespace orbid::apps
