#include "apps/results/branch_file.hpp"

#include <array>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include "apps/documents/json_text.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/results/orbit_file.hpp"
#include "apps/results/result_file.hpp"
#include "periodic/branches/continuation.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;
using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchEnd;
using periodic::BranchPoint;

Json place_json(const BranchPlace& place) {
    return Json::array({place.branch, place.point});
}

constexpr std::array amplitude_measures{periodic::OrbitMeasure::maximum, periodic::OrbitMeasure::minimum,
                                        periodic::OrbitMeasure::mean, periodic::OrbitMeasure::half_range,
                                        periodic::OrbitMeasure::rms};

/// Orbits per second; per iteration of a map.
double frequency(const BranchPoint& point) {
    return measure_of(point, periodic::OrbitMeasure::frequency, 0);
}

Json point_json(const BranchPoint& point) {
    const bool located = point.bifurcation != Bifurcation::none;
    return {{"parameter", point.parameter},
            {"arclength", point.arclength},
            {"period", point.orbit.period},
            {"rotation", point.orbit.rotation},
            {"time", point.orbit.time},
            {"points", detail::rows_or_null(point.orbit.points.transpose())},
            {"multipliers", detail::complex_pairs(point.orbit.multipliers)},
            {"unstable", point.unstable},
            {"bifurcation", located ? Json(periodic::name(point.bifurcation)) : Json(nullptr)},
            {"parameter_error", located ? Json(point.parameter_error) : Json(nullptr)},
            {"frequency", frequency(point)},
            {"amplitude", point.amplitude.mean.size() > 0 ? detail::amplitude_json(point.amplitude) : Json(nullptr)}};
}

/// The columns of branch.csv behind the coordinates; cells of what is not known are empty.
std::string amplitude_cells(const BranchPoint& point, std::size_t quantities) {
    std::string text = fmt::format(",{}", frequency(point));
    for (std::size_t i = 0; i < quantities; ++i)
        for (const periodic::OrbitMeasure measure : amplitude_measures) {
            const double value = measure_of(point, measure, static_cast<Eigen::Index>(i));
            text += std::isfinite(value) ? fmt::format(",{}", value) : std::string(",");
        }
    return text;
}

Json measured_json(const MeasuredMotion& motion) {
    const Json values = json_list(motion.values, [](const MeasuredMotion::Value& one) -> Json {
        return {{"name", one.name},
                {"observed", one.observed},
                {"predicted", one.predicted},
                {"sd", one.sd},
                {"unit", one.unit}};
    });
    return {{"label", motion.label},
            {"parameter", motion.parameter},
            {"used", motion.used},
            {"unstable", json_or_null(motion.unstable)},
            {"values", values}};
}

MeasuredMotion measured_of(const nlohmann::json& json) {
    MeasuredMotion motion;
    motion.label = json.at("label").get<std::string>();
    motion.parameter = json.at("parameter").get<double>();
    motion.used = json.at("used").get<bool>();
    if (json.at("unstable").is_number()) motion.unstable = whole_number<int>(json["unstable"]);
    for (const auto& one : json.at("values"))
        motion.values.push_back({one.at("name").get<std::string>(), one.at("unit").get<std::string>(),
                                 detail::number_of(one.at("observed")), detail::number_of(one.at("predicted")),
                                 detail::number_of(one.at("sd"))});
    return motion;
}

Json cascades_json(const std::vector<Branch>& branches) {
    return json_list(doubling_cascades(branches), [&](const std::vector<BranchPlace>& cascade) -> Json {
        std::vector<double> values;
        std::vector<double> errors;
        for (const BranchPlace& place : cascade) {
            const BranchPoint& point = branches[place.branch].points[place.point];
            values.push_back(point.parameter);
            errors.push_back(point.parameter_error);
        }
        return {{"doublings", json_list(cascade, place_json)},
                {"parameter", values},
                {"parameter_error", errors},
                {"ratios", periodic::doubling_ratios(values)}};
    });
}

BranchPoint point_of(const nlohmann::json& json) {
    BranchPoint point;
    point.parameter = json.at("parameter").get<double>();
    point.arclength = json.at("arclength").get<double>();
    point.orbit.status = periodic::OrbitStatus::converged;
    point.orbit.period = whole_number<int>(json.at("period"));
    point.orbit.rotation = whole_numbers<int>(json.at("rotation"));
    point.orbit.time = detail::number_of(json.at("time"));
    point.orbit.points = detail::columns_of(json.at("points"));
    point.orbit.multipliers = detail::complex_of(json.at("multipliers"));
    point.unstable = whole_number<int>(json.at("unstable"));
    if (!json.at("bifurcation").is_null()) {
        point.bifurcation = detail::named(json["bifurcation"].get<std::string>(), Bifurcation::branch_point).value();
        point.parameter_error = detail::number_of(json.at("parameter_error"));
    }
    point.amplitude = detail::amplitude_from(json);
    return point;
}

Branch branch_of(const nlohmann::json& json) {
    Branch branch;
    if (!json.at("origin").is_null())
        branch.origin = Branch::Origin{whole_number<std::size_t>(json["origin"].at(0)),
                                       whole_number<std::size_t>(json["origin"].at(1))};
    branch.first = detail::named(json.at("ends").at(0).get<std::string>(), BranchEnd::interrupted).value();
    branch.last = detail::named(json.at("ends").at(1).get<std::string>(), BranchEnd::interrupted).value();
    for (const auto& point : json.at("points"))
        branch.points.push_back(point_of(point));
    return branch;
}

}  // namespace

std::string branches_text(const CycleFileHead& head, const models::Parameter& parameter, double lower, double upper,
                          const FollowedBranches& followed) {
    Json out = detail::head_document(head);
    out["format"] = "orbid-branches/1";
    out["parameter"] = {{"name", parameter.name}, {"unit", parameter.unit}, {"range", {lower, upper}}};
    out["message"] = json_or_null(followed.message);
    out["cascades"] = cascades_json(followed.branches);
    if (!followed.readings.empty())
        out["readings"] = json_list(followed.readings, [](const orbits::SeriesCoordinate& one) -> Json {
            return {{"name", one.name}, {"unit", one.unit}};
        });
    out["branches"] = json_list(followed.branches, [](const Branch& branch) -> Json {
        return {{"origin", branch.origin ? place_json({branch.origin->branch, branch.origin->point}) : Json(nullptr)},
                {"ends", {periodic::name(branch.first), periodic::name(branch.last)}},
                {"points", json_list(branch.points, point_json)}};
    });
    for (std::size_t b = 0; b < followed.pieces.size(); ++b)
        out["branches"][b]["piece"] = followed.pieces[b];
    if (!followed.measured.empty()) out["measured"] = json_list(followed.measured, measured_json);
    return json_text(out);
}

std::string branches_csv(const CycleFileHead& head, const models::Parameter& parameter,
                         const FollowedBranches& followed, const FurtherColumns& further) {
    std::string text = fmt::format(
        "branch,point,{},arclength,period,time,unstable,bifurcation,multiplier_re,"
        "multiplier_im,section",
        parameter.name);
    for (const auto& coordinate : head.coordinates)
        text += "," + coordinate.name;
    text += ",frequency";
    auto quantities = head.coordinates;
    quantities.insert(quantities.end(), followed.readings.begin(), followed.readings.end());
    for (const auto& quantity : quantities)
        for (const periodic::OrbitMeasure measure : amplitude_measures)
            text += fmt::format(",{}_{}", quantity.name, periodic::name_of(measure));
    if (!followed.pieces.empty()) text += ",piece";
    text += further.header;
    text += '\n';
    for (std::size_t b = 0; b < followed.branches.size(); ++b) {
        const auto& points = followed.branches[b].points;
        for (std::size_t k = 0; k < points.size(); ++k) {
            const BranchPoint& point = points[k];
            const periodic::PeriodicOrbit& orbit = point.orbit;
            const auto multiplier = orbit.multipliers.empty() ? std::string(",")
                                                              : fmt::format("{},{}", orbit.multipliers[0].real(),
                                                                            orbit.multipliers[0].imag());
            const std::string_view bifurcation =
                point.bifurcation == Bifurcation::none ? std::string_view() : periodic::name(point.bifurcation);
            std::string amplitude = amplitude_cells(point, quantities.size());
            if (!followed.pieces.empty()) amplitude += "," + csv_cell(followed.pieces[b]);
            if (!further.header.empty()) amplitude += further.cells[b][k];
            for (Eigen::Index j = 0; j < orbit.points.cols(); ++j) {
                text += fmt::format("{},{},{},{},{},{},{},{},{},{}", b, k, point.parameter, point.arclength,
                                    orbit.period, orbit.time, point.unstable, bifurcation, multiplier, j);
                for (Eigen::Index i = 0; i < orbit.points.rows(); ++i)
                    text += fmt::format(",{}", orbit.points(i, j));
                text += amplitude;
                text += '\n';
            }
        }
    }
    return text;
}

std::optional<StoredBranches> stored_branches(std::string_view text) {
    const auto json = json_value_or_discarded(text);
    try {
        StoredBranches stored;
        if (json.contains("fingerprint")) stored.fingerprint = json["fingerprint"].dump();
        if (json.at("message").is_string()) stored.followed.message = json["message"].get<std::string>();
        for (const auto& branch : json.at("branches")) {
            stored.followed.branches.push_back(branch_of(branch));
            if (branch.contains("piece")) stored.followed.pieces.push_back(branch["piece"].get<std::string>());
        }
        if (json.contains("readings"))
            for (const auto& one : json["readings"])
                stored.followed.readings.push_back(
                    {one.at("name").get<std::string>(), one.at("unit").get<std::string>(), false});
        if (json.contains("measured"))
            for (const auto& motion : json["measured"])
                stored.followed.measured.push_back(measured_of(motion));
        return stored;
    } catch (const std::bad_optional_access&) {
        return std::nullopt;  // a name of another version
    } catch (const nlohmann::json::exception&) {
        return std::nullopt;  // another layout: not ours, or of an older version
    }
}

}  // namespace orbid::apps
