#include "apps/stored_run/motion_results.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/json_text.hpp"
#include "apps/results/cycle_file.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;
using Eigen::Index;
using identification::PredictedQuantities;

/// An interval is null as a whole where one of its ends is not known.
Json band_json(const PredictedQuantities& all, Index i) {
    Json out;
    out["value"] = all.value(i);
    out["sd"] = all.sd.size() > 0 ? all.sd(i) : std::nan("");
    const bool known = all.lower95.size() > 0 && std::isfinite(all.lower95(i)) && std::isfinite(all.upper95(i));
    out["interval95"] = known ? Json::array({all.lower95(i), all.upper95(i)}) : Json(nullptr);
    out["delta_sd"] = all.delta_sd.size() > 0 ? all.delta_sd(i) : std::nan("");
    return out;
}

Json quantities_json(const MotionPrediction& prediction, const PredictedQuantities& all) {
    Json out = Json::object();
    for (std::size_t i = 0; i < prediction.quantities.size(); ++i)
        out[prediction.quantities[i]] = band_json(all, static_cast<Index>(i));
    return out;
}

Json orbit_json(const MotionPrediction& prediction, const AskedOrbit& asked) {
    const periodic::PeriodicOrbit& orbit = asked.predicted.orbit;
    Json at = Json::object();
    for (const auto& [name, value] : asked.at)
        at[name] = value;
    Json out{{"start", asked.start}, {"at", at}, {"status", periodic::name(orbit.status)}};
    if (orbit.status != periodic::OrbitStatus::converged) return out;
    const PredictedQuantities& all = asked.predicted.quantities;
    out["found"] = all.found;
    out["stable"] = all.stable;
    out["period"] = orbit.period;
    out["rotation"] = orbit.rotation;
    out["time"] = orbit.time;
    out["multipliers"] = detail::complex_pairs(orbit.multipliers);
    out["quantities"] = quantities_json(prediction, all);
    out["points"] = Json::array();
    const Index first = asked.predicted.layout.first_point();
    const Index n = asked.predicted.layout.coordinates;
    for (Index j = 0; j * n < asked.predicted.layout.points; ++j) {
        Json point = Json::array();
        for (Index i = 0; i < n; ++i)
            point.push_back(band_json(all, first + j * n + i));
        out["points"].push_back(std::move(point));
    }
    return out;
}

Json branch_json(const MotionPrediction& prediction) {
    const identification::PredictedBranch& branch = prediction.branch;
    Json out{{"parameter", {{"name", prediction.parameter}, {"unit", prediction.unit}}},
             {"message", json_or_null(prediction.followed.message)},
             {"followed", branch.followed},
             {"marks", Json::array()},
             {"points", Json::array()}};
    for (const auto& one : branch.marks) {
        Json mark{{"name", one.mark.name}, {"kind", one.mark.kind}, {"found", one.parameter.found}};
        mark.update(band_json(one.parameter, 0));
        out["marks"].push_back(std::move(mark));
    }
    for (std::size_t k = 0; k < branch.points.size(); ++k)
        out["points"].push_back({{"parameter", branch.branch.points[k].parameter},
                                 {"sheet", branch.sheets[k]},
                                 {"found", branch.points[k].found},
                                 {"stable", branch.points[k].stable},
                                 {"quantities", quantities_json(prediction, branch.points[k])}});
    return out;
}

Json compared_json(const ComparedMeasure& one) {
    const bool predicted = std::isfinite(one.predicted);
    const bool known = std::isfinite(one.lower95) && std::isfinite(one.upper95);
    Json out{
        {"motion", one.motion},
        {"parameter", one.parameter},
        {"measure", one.name},
        {"unit", one.unit},
        {"observed", one.observed},
        {"predicted", one.predicted},
        {"sd", one.sd},
        {"interval95", known ? Json::array({one.lower95, one.upper95}) : Json(nullptr)},
        {"inside", known ? Json(one.inside()) : Json(nullptr)},
        {"error_sd", one.error_sd},
        {"inside_with_errors", known && std::isfinite(one.error_sd) ? Json(one.inside_with_errors()) : Json(nullptr)},
        {"relative_error", predicted ? one.relative_error() : std::nan("")}};
    out["sheet"] = predicted || one.found > 0 ? Json(one.sheet) : Json(nullptr);
    out["found"] = one.found;
    out["is_stable"] = predicted || one.found > 0 ? Json(one.is_stable) : Json(nullptr);
    out["stable"] = one.stable;
    return out;
}

}  // namespace

std::string motion_prediction_text(const MotionPrediction& prediction) {
    Json out;
    out["format"] = "orbid-prediction/1";
    out["kind"] = "periodic";
    const char* source = prediction.draws == 0    ? "delta method"
                         : prediction.from_sample ? "draws from the posterior sample"
                                                  : "draws from the normal approximation in the scales of the estimate";
    out["posterior"] = {{"method", source},
                        {"draws", prediction.draws},
                        {"outside", prediction.outside},
                        {"parameters", prediction.parameters}};
    out["orbits"] = json_list(prediction.orbits, [&](const AskedOrbit& one) { return orbit_json(prediction, one); });
    if (prediction.has_branch) out["branch"] = branch_json(prediction);
    out["measured"] = json_list(prediction.compared, compared_json);
    out["remarks"] = prediction.remarks;
    return json_text(out);
}

std::string predicted_branch_csv(const CycleFileHead& head, const models::Parameter& parameter,
                                 const MotionPrediction& prediction) {
    std::vector<std::vector<std::string>> cells(1);
    std::string header = ",sheet,draws_found,draws_stable";
    for (const std::string& name : prediction.quantities) {
        std::string column = name;
        std::replace(column.begin(), column.end(), '.', '_');
        header += fmt::format(",{0}_sd,{0}_lower95,{0}_upper95", column);
    }
    const auto cell = [](double value) { return std::isfinite(value) ? fmt::format(",{}", value) : std::string(","); };
    for (std::size_t k = 0; k < prediction.branch.points.size(); ++k) {
        const PredictedQuantities& all = prediction.branch.points[k];
        std::string text = fmt::format(",{},{}", prediction.branch.sheets[k], all.found) + cell(all.stable);
        for (std::size_t i = 0; i < prediction.quantities.size(); ++i) {
            const auto at = static_cast<Index>(i);
            text += cell(all.sd.size() > 0 ? all.sd(at) : std::nan("")) +
                    cell(all.lower95.size() > 0 ? all.lower95(at) : std::nan("")) +
                    cell(all.upper95.size() > 0 ? all.upper95(at) : std::nan(""));
        }
        cells.front().push_back(std::move(text));
    }
    return branches_csv(head, parameter, prediction.followed, {header, cells});
}

}  // namespace orbid::apps
