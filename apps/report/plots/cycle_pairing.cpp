#include "apps/report/plots/cycle_pairing.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "apps/documents/json_value.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

/// Points of one cycle, point by point.
using Points = std::vector<std::vector<double>>;

using PointsByPeriod = std::map<int, std::vector<Points>>;

PointsByPeriod points_of(const Json& list) {
    PointsByPeriod periods;
    for (const Json& cycle : list.at("cycles")) {
        if (cycle.contains("status") && cycle["status"] != "converged") continue;
        periods[whole_number<int>(cycle.at("period"))].push_back(cycle.at("points").get<Points>());
    }
    return periods;
}

/// Largest distance between the points of two cycles over the ranges, at the best of all shifts.
double distance(const Points& a, const Points& b, const std::vector<double>& range, const std::vector<bool>& angle) {
    double best = std::numeric_limits<double>::infinity();
    for (std::size_t shift = 0; shift < b.size(); ++shift) {
        double largest = 0.0;
        for (std::size_t j = 0; j < a.size() && largest < best; ++j) {
            const auto& other = b[(j + shift) % b.size()];
            for (std::size_t i = 0; i < range.size(); ++i) {
                const double step =
                    angle[i] ? models::wrapped(a.at(j).at(i) - other.at(i)) : a.at(j).at(i) - other.at(i);
                largest = std::max(largest, std::abs(step) / range[i]);
            }
        }
        best = std::min(best, largest);
    }
    return best;
}

/// How distances are measured: ranges of the coordinates over both lists, and which of them are angles.
struct Scale {
    std::vector<double> range;
    std::vector<bool> angle;
};

Scale scale_of(const PointsByPeriod& a, const PointsByPeriod& b, const ModelJob& model, const Json& coordinates) {
    const std::size_t dimension = coordinates.size();
    std::vector<double> lowest(dimension, std::numeric_limits<double>::infinity());
    std::vector<double> highest(dimension, -std::numeric_limits<double>::infinity());
    const auto include = [&](const std::vector<double>& point) {
        for (std::size_t i = 0; i < dimension; ++i) {
            lowest[i] = std::min(lowest.at(i), point[i]);
            highest[i] = std::max(highest[i], point[i]);
        }
    };
    for (const auto* periods : {&a, &b}) {
        for (const auto& [period, list] : *periods) {
            for (const Points& points : list)
                std::for_each(points.begin(), points.end(), include);
        }
    }
    Scale scale;
    for (std::size_t i = 0; i < dimension; ++i) {
        scale.range.push_back(highest[i] > lowest[i] ? highest[i] - lowest[i] : 1.0);
        scale.angle.push_back(catalog::coordinate_of(model, coordinates.at(i).get<std::string>()).angle);
    }
    return scale;
}

/// Distances of the cycles that both lists hold, in ascending order.
std::vector<double> common_cycles(const std::vector<Points>& mine, const std::vector<Points>& theirs,
                                  const Scale& scale) {
    // Two cycles are the same when no point differs by more than this share of the range: neighbours of period 5 of
    // the pendulum are ten times as far apart.
    constexpr double same = 0.01;
    std::vector<Pairing> pairs;
    for (std::size_t i = 0; i < mine.size(); ++i) {
        for (std::size_t j = 0; j < theirs.size(); ++j) {
            const double apart = distance(mine[i], theirs[j], scale.range, scale.angle);
            if (apart < same) pairs.push_back({apart, i, j});
        }
    }
    std::vector<double> distances;
    for (const Pairing& pair : nearest_pairs(std::move(pairs)))
        distances.push_back(pair.distance);
    return distances;
}

}  // namespace

std::vector<Pairing> nearest_pairs(std::vector<Pairing> candidates) {
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Pairing& x, const Pairing& y) { return x.distance < y.distance; });
    std::set<std::size_t> taken_first;
    std::set<std::size_t> taken_second;
    std::vector<Pairing> pairs;
    for (const Pairing& pair : candidates) {
        if (taken_first.contains(pair.first) || taken_second.contains(pair.second)) continue;
        taken_first.insert(pair.first);
        taken_second.insert(pair.second);
        pairs.push_back(pair);
    }
    return pairs;
}

MatchedCycles matched_cycles(const StoredRun& run, const Json& first, const Json& second) {
    MatchedCycles out;
    if (first.value("coordinates", Json()) != second.value("coordinates", Json())) return out;
    const auto a = points_of(first);
    const auto b = points_of(second);
    const Scale scale = scale_of(a, b, stored_model(run), first.at("coordinates"));
    SummaryTable table({{"period"}, {"first"}, {"second"}, {"in both"}, {"median distance / range"}});
    std::set<int> periods;
    for (const auto* list : {&a, &b}) {
        for (const auto& entry : *list)
            periods.insert(entry.first);
    }
    for (const int period : periods) {
        static const std::vector<Points> none;
        const auto& mine = a.contains(period) ? a.at(period) : none;
        const auto& theirs = b.contains(period) ? b.at(period) : none;
        const auto distances = common_cycles(mine, theirs, scale);
        out.common += distances.size();
        table.add({std::to_string(period), std::to_string(mine.size()), std::to_string(theirs.size()),
                   std::to_string(distances.size()),
                   distances.empty() ? std::string() : significant(distances[distances.size() / 2], 2)});
    }
    out.table = table.text();
    return out;
}

}  // namespace orbid::apps
