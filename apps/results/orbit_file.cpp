#include "apps/results/orbit_file.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/documents/json_text.hpp"
#include "apps/documents/json_value.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;
using periodic::Bifurcation;
using periodic::OrbitStatus;

void add_stability(const periodic::Stability& stability, std::size_t parameters, Json& out) {
    out["unstable"] = stability.unstable;
    out["bifurcation_near"] = periodic::name(stability.nearest);
    out["directions"] = json_list(stability.directions, [](const Eigen::MatrixXcd& at_point) {
        Json point = Json::array();
        for (Eigen::Index m = 0; m < at_point.cols(); ++m)
            point.push_back(json_list(at_point.col(m), detail::complex_pair));
        return point;
    });
    out["ln_multiplier_sensitivities"] =
        parameters == 0 ? Json(nullptr) : detail::rows_or_null(stability.ln_multiplier_sensitivities);
}

Json orbit_json(const CycleFileHead& head, const ComputedOrbit& computed, std::size_t parameters, std::size_t index) {
    const periodic::PeriodicOrbit& orbit = computed.orbit;
    const auto n = static_cast<Eigen::Index>(head.coordinates.size());
    detail::require_points(orbit.points, orbit.period, head.coordinates.size(), index);
    detail::require_shape(orbit.sensitivities, n * orbit.period, static_cast<Eigen::Index>(parameters), "sensitivities",
                          index);
    Json out;
    out["status"] = computed.status();
    out["message"] = json_or_null(computed.message);
    out["period"] = orbit.period;
    out["rotation"] = orbit.rotation;
    out["points"] = detail::rows_or_null(orbit.points.transpose());
    out["covariance"] = nullptr;  // computed, not measured
    out["multipliers"] = detail::complex_pairs(orbit.multipliers);
    // -infinity (sticking) becomes null.
    out["ln_multiplier"] =
        json_list(orbit.multipliers, [](std::complex<double> multiplier) { return std::log(std::abs(multiplier)); });
    out["ln_multiplier_covariance"] = nullptr;
    out["time"] = head.own_time ? Json(orbit.time) : detail::time_of(head, orbit.period);
    if (head.own_time) {
        out["times"] = json_list(orbit.times);
        out["time_sensitivities"] = json_list(orbit.time_sensitivities);
        if (orbit.time_sensitivities.size() > 0)
            out["trivial_multiplier"] = detail::complex_pair(orbit.trivial_multiplier);
    }
    out["recurrences"] = nullptr;
    out["mirror"] = json_or_null(computed.mirror);
    out["quality"] = orbit.sticking ? Json::array({"sticking"}) : Json::array();
    out["origin"] = computed.origin;
    if (computed.searched()) out["hits"] = computed.hits;
    out["residual"] = orbit.residual;
    out["discretisation_error"] = orbit.discretisation_error;
    out["iterations"] = orbit.iterations;
    out["distance"] = orbit.distance;
    if (computed.stability) add_stability(*computed.stability, parameters, out);
    out["sensitivities"] = detail::rows_or_null(orbit.sensitivities);
    if (computed.amplitude.mean.size() > 0) {
        out["frequency"] = orbit.time > 0.0 ? Json(1.0 / orbit.time) : Json(nullptr);
        out["amplitude"] = detail::amplitude_json(computed.amplitude);
    }
    return out;
}

ComputedOrbit orbit_of(const nlohmann::json& json) {
    ComputedOrbit computed;
    periodic::PeriodicOrbit& orbit = computed.orbit;
    const auto status = detail::named(json.at("status").get<std::string>(), OrbitStatus::period_vanished);
    computed.computed = status.has_value();
    orbit.status = status.value_or(OrbitStatus::no_progress);
    if (json.at("message").is_string()) computed.message = json["message"].get<std::string>();
    orbit.period = whole_number<int>(json.at("period"));
    orbit.rotation = whole_numbers<int>(json.at("rotation"));
    orbit.points = detail::columns_of(json.at("points"));
    orbit.multipliers = detail::complex_of(json.at("multipliers"));
    orbit.time = detail::number_of(json.at("time"));
    if (json.at("mirror").is_number()) computed.mirror = whole_number<int>(json["mirror"]);
    orbit.sticking = !json.at("quality").empty();
    computed.origin = json.at("origin").get<std::string>();
    computed.hits = json.contains("hits") ? whole_number<std::size_t>(json["hits"]) : 1;
    orbit.residual = detail::number_of(json.at("residual"));
    orbit.iterations = whole_number<int>(json.at("iterations"));
    orbit.distance = detail::number_of(json.at("distance"));
    computed.amplitude = detail::amplitude_from(json);
    if (json.contains("unstable")) {
        computed.stability.emplace();
        computed.stability->unstable = whole_number<int>(json["unstable"]);
        computed.stability->nearest =
            detail::named(json.at("bifurcation_near").get<std::string>(), Bifurcation::branch_point)
                .value_or(Bifurcation::none);
    }
    return computed;
}

/// Of every orbit as many points as its period, all of one dimension; mirror images that are in the list.
bool consistent(const std::vector<ComputedOrbit>& list) {
    return std::all_of(list.begin(), list.end(), [&](const ComputedOrbit& one) {
        const periodic::PeriodicOrbit& orbit = one.orbit;
        const bool mirrored = !one.mirror || (*one.mirror >= 0 && static_cast<std::size_t>(*one.mirror) < list.size());
        const bool whole =
            orbit.points.cols() == orbit.period && orbit.points.rows() == list.front().orbit.points.rows();
        return orbit.period >= 1 && mirrored && (whole || (!one.computed && orbit.points.size() == 0));
    });
}

}  // namespace

namespace detail {

double number_of(const nlohmann::json& value) {
    return value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
}

Eigen::MatrixXd columns_of(const nlohmann::json& rows) {
    if (rows.empty()) return {};
    Eigen::MatrixXd columns(static_cast<Eigen::Index>(rows.at(0).size()), static_cast<Eigen::Index>(rows.size()));
    for (Eigen::Index j = 0; j < columns.cols(); ++j)
        for (Eigen::Index i = 0; i < columns.rows(); ++i)
            columns(i, j) = number_of(rows.at(static_cast<std::size_t>(j)).at(static_cast<std::size_t>(i)));
    return columns;
}

Json amplitude_json(const periodic::OrbitAmplitude& amplitude) {
    return {{"max", json_list(amplitude.maximum)},
            {"min", json_list(amplitude.minimum)},
            {"mean", json_list(amplitude.mean)},
            {"half_range", json_list(amplitude.half_range)},
            {"rms", json_list(amplitude.rms)}};
}

periodic::OrbitAmplitude amplitude_from(const nlohmann::json& orbit) {
    if (!orbit.contains("amplitude") || orbit["amplitude"].is_null()) return {};
    const auto values = [&](const char* key) {
        const nlohmann::json& list = orbit["amplitude"].at(key);
        Eigen::VectorXd result(static_cast<Eigen::Index>(list.size()));
        for (std::size_t i = 0; i < list.size(); ++i)
            result(static_cast<Eigen::Index>(i)) = number_of(list[i]);
        return result;
    };
    return {values("max"), values("min"), values("mean"), values("half_range"), values("rms")};
}

std::vector<std::complex<double>> complex_of(const nlohmann::json& pairs) {
    std::vector<std::complex<double>> values;
    for (const auto& pair : pairs)
        values.emplace_back(number_of(pair.at(0)), number_of(pair.at(1)));
    return values;
}

}  // namespace detail

std::string orbits_text(const CycleFileHead& head, const ComputedOrbits& orbits,
                        const std::vector<std::string>& parameters) {
    Json out = detail::head_document(head);
    out["parameters"] = parameters;
    if (orbits.searched)
        out["search"] = {{"starts", orbits.starts},
                         {"captured", orbits.captured},
                         {"unsettled", orbits.unsettled},
                         {"index_sums", orbits.index_sums}};
    out["cycles"] = Json::array();
    for (std::size_t i = 0; i < orbits.list.size(); ++i)
        out["cycles"].push_back(orbit_json(head, orbits.list[i], parameters.size(), i));
    return json_text(out);
}

std::optional<StoredOrbits> stored_orbits(std::string_view text) {
    const auto json = json_value_or_discarded(text);
    try {
        StoredOrbits stored;
        if (json.contains("fingerprint")) stored.fingerprint = json["fingerprint"].dump();
        for (const auto& orbit : json.at("cycles"))
            stored.orbits.list.push_back(orbit_of(orbit));
        if (json.contains("search")) {
            stored.orbits.searched = true;
            stored.orbits.starts = whole_number<std::size_t>(json["search"].at("starts"));
            stored.orbits.captured = whole_number<std::size_t>(json["search"].at("captured"));
            stored.orbits.unsettled = whole_numbers<int>(json["search"].at("unsettled"));
            stored.orbits.index_sums = whole_numbers<int>(json["search"].at("index_sums"));
        }
        return consistent(stored.orbits.list) ? std::optional(std::move(stored)) : std::nullopt;
    } catch (const nlohmann::json::exception&) {
        return std::nullopt;  // another layout: not ours, or of an older version
    }
}

}  // namespace orbid::apps
