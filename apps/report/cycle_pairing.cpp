#include "apps/report/cycle_pairing.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "apps/results/summary_table.hpp"
#include "apps/stored_run/stored_record.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

/// Points of one cycle, point by point.
using Points = std::vector<std::vector<double>>;

std::map<int, std::vector<Points>> points_of(const Json& list) {
    std::map<int, std::vector<Points>> periods;
    for (const Json& cycle : list.at("cycles")) {
        if (cycle.contains("status") && cycle["status"] != "converged") continue;
        periods[cycle.at("period").get<int>()].push_back(cycle.at("points").get<Points>());
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
                const double step = angle[i] ? models::wrapped(a[j][i] - other[i]) : a[j][i] - other[i];
                largest = std::max(largest, std::abs(step) / range[i]);
            }
        }
        best = std::min(best, largest);
    }
    return best;
}

}  // namespace

MatchedCycles matched_cycles(const StoredRun& run, const Json& first, const Json& second) {
    MatchedCycles out;
    if (first.value("coordinates", Json()) != second.value("coordinates", Json())) return out;
    // Two cycles are the same when no point differs by more than this share of the range: neighbours of period 5 of
    // the pendulum are ten times as far apart.
    constexpr double same = 0.01;
    const auto a = points_of(first);
    const auto b = points_of(second);
    const std::size_t dimension = first.at("coordinates").size();
    std::vector<double> lowest(dimension, std::numeric_limits<double>::infinity());
    std::vector<double> highest(dimension, -std::numeric_limits<double>::infinity());
    for (const auto* periods : {&a, &b}) {
        for (const auto& [period, list] : *periods) {
            for (const Points& points : list) {
                for (const auto& point : points) {
                    for (std::size_t i = 0; i < dimension; ++i) {
                        lowest[i] = std::min(lowest[i], point[i]);
                        highest[i] = std::max(highest[i], point[i]);
                    }
                }
            }
        }
    }
    std::vector<double> range;
    std::vector<bool> angle;
    const ModelJob model = stored_model(run);
    for (std::size_t i = 0; i < dimension; ++i) {
        range.push_back(highest[i] > lowest[i] ? highest[i] - lowest[i] : 1.0);
        angle.push_back(catalog::coordinate_of(model, first.at("coordinates")[i].get<std::string>()).angle);
    }
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
        struct Pair {
            double distance;
            std::size_t first;
            std::size_t second;
        };
        std::vector<Pair> pairs;
        for (std::size_t i = 0; i < mine.size(); ++i) {
            for (std::size_t j = 0; j < theirs.size(); ++j) {
                const double apart = distance(mine[i], theirs[j], range, angle);
                if (apart < same) pairs.push_back({apart, i, j});
            }
        }
        std::stable_sort(pairs.begin(), pairs.end(),
                         [](const Pair& x, const Pair& y) { return x.distance < y.distance; });
        std::vector<bool> taken_first(mine.size(), false);
        std::vector<bool> taken_second(theirs.size(), false);
        std::vector<double> distances;
        for (const Pair& pair : pairs) {
            if (taken_first[pair.first] || taken_second[pair.second]) continue;
            taken_first[pair.first] = taken_second[pair.second] = true;
            distances.push_back(pair.distance);
        }
        out.common += distances.size();
        table.add({std::to_string(period), std::to_string(mine.size()), std::to_string(theirs.size()),
                   std::to_string(distances.size()),
                   distances.empty() ? std::string() : significant(distances[distances.size() / 2], 2)});
    }
    out.table = table.text();
    return out;
}

}  // namespace orbid::apps
