#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "apps/documents/atomic_file.hpp"
#include "apps/drawing/figure.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/results/branch_file.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps::catalog {

namespace {

using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchPoint;

struct Mark {
    Bifurcation bifurcation;
    std::string_view name;
    std::size_t shape;  ///< of series_marker
};

/// Open shapes, so that the lines below stay visible.
constexpr std::array<Mark, 4> marks{{{Bifurcation::period_doubling, "period doubling", 0},
                                     {Bifurcation::fold, "fold", 1},
                                     {Bifurcation::branch_point, "branch point", 3},
                                     {Bifurcation::neimark_sacker, "Neimark-Sacker", 2}}};

/// Which coordinate of the points is shown upwards; -1: the time T.
Eigen::Index shown_coordinate(const StoredRun& run) {
    const auto pointer = StoredRun::Json::json_pointer("/periodic/continuation/plot");
    if (!run.job.contains(pointer) || !run.job.at(pointer).is_string()) return -1;
    const auto& names = run.branch->at("coordinates");
    const auto found = std::find(names.begin(), names.end(), run.job.at(pointer));
    return found == names.end() ? -1 : static_cast<Eigen::Index>(found - names.begin());
}

Eigen::Index count_of(const BranchPoint& point, Eigen::Index shown) {
    return shown < 0 ? 1 : point.orbit.points.cols();
}

double value_of(const BranchPoint& point, Eigen::Index shown, Eigen::Index j) {
    // The orbit that a doubled branch begins with has half as many points.
    return shown < 0 ? point.orbit.time : point.orbit.points(shown, j % point.orbit.points.cols());
}

/// At a bifurcation a multiplier is on the unit circle, and rounding decides on which side: the ordinary neighbour
/// says what lies between.
bool stable_after(const std::vector<BranchPoint>& points, std::size_t k) {
    return (points[k].bifurcation == Bifurcation::none ? points[k] : points[k + 1]).unstable == 0;
}

/// The curve that point j of the orbits draws, in stable and unstable pieces.
void draw_curve(Panel& panel, const Branch& branch, Eigen::Index shown, Eigen::Index j, std::string_view colour) {
    const auto& points = branch.points;
    for (std::size_t k = 0; k + 1 < points.size();) {
        const bool stable = stable_after(points, k);
        std::size_t end = k + 1;
        while (end + 1 < points.size() && stable_after(points, end) == stable)
            ++end;
        std::vector<double> x;
        std::vector<double> y;
        for (std::size_t i = k; i <= end; ++i) {
            x.push_back(points[i].parameter);
            y.push_back(value_of(points[i], shown, j));
        }
        panel.curve(x, y, {colour, stable ? 1.0 : 0.7, stable ? std::string_view() : std::string_view("2.2 1.6")});
        k = end;
    }
}

}  // namespace

bool has_branch(const StoredRun& run) {
    return run.branch && run.branch->contains("branches") && !run.branch->at("branches").empty();
}

std::string branch(const StoredRun& run, const PlotStyle& style) {
    const auto file = run.folder / "branch.json";
    const auto stored = stored_branches(read_whole_file(file));
    if (!stored) throw orbits::DataError(file.string() + ": does not hold the branches of this version");
    const auto& branches = stored->followed.branches;
    const Eigen::Index shown = shown_coordinate(run);

    constexpr double infinity = std::numeric_limits<double>::infinity();
    std::array<double, 2> x_range{infinity, -infinity};
    std::array<double, 2> y_range{infinity, -infinity};
    std::set<int> periods;
    std::size_t orbits = 0;
    for (const Branch& one : branches) {
        periods.insert(branch_period(one));
        orbits += one.points.size();
        for (const BranchPoint& point : one.points) {
            x_range = {std::min(x_range[0], point.parameter), std::max(x_range[1], point.parameter)};
            for (Eigen::Index j = 0; j < count_of(point, shown); ++j) {
                const double value = value_of(point, shown, j);
                y_range = {std::min(y_range[0], value), std::max(y_range[1], value)};
            }
        }
    }
    orbits::SeriesCoordinate coordinate{"T", "s", false};
    if (shown >= 0) {
        const auto index = static_cast<std::size_t>(shown);
        coordinate.name = run.branch->at("coordinates")[index].get<std::string>();
        coordinate.unit = run.branch->at("units")[index].get<std::string>();
        const ModelJob model = stored_model(run);
        const Eigen::Index of_model = model.system->coordinate_index(coordinate.name);
        const bool angle = of_model >= 0 && model.system->coordinates()[static_cast<std::size_t>(of_model)].angle;
        // Branches fill a small part of the circle: an angle that stays away from the cut has an axis of its own.
        constexpr double quarter = 0.5 * std::numbers::pi;
        coordinate.angle = angle && !(y_range[0] > -quarter && y_range[1] < quarter);
    }

    Figure figure(style);
    figure.title(run.title());
    std::vector<LegendEntry> legend;
    for (const int period : periods) {
        // Periods from 8 on share one colour.
        const bool several = period >= 8 && period != *periods.rbegin();
        legend.push_back({fmt::format("period {}{}", period, several ? " …" : ""),
                          LegendEntry::Kind::line,
                          {},
                          {plot_marker(period).colour, 1.4}});
        if (several) break;
    }
    legend.push_back({"unstable", LegendEntry::Kind::line, {}, {"#39424f", 0.8, "2.2 1.6"}});
    std::set<Bifurcation> kinds;
    const auto places = located_bifurcations(branches);
    for (const BranchPlace& place : places)
        kinds.insert(branches[place.branch].points[place.point].bifurcation);
    const double radius = 0.26 * figure.font();
    for (const Mark& mark : marks) {
        if (kinds.contains(mark.bifurcation))
            legend.push_back({std::string(mark.name),
                              LegendEntry::Kind::marker,
                              PlotMarker{"#1d2430", series_marker(mark.shape, radius).outline},
                              {},
                              true});
    }
    figure.legend(legend);
    const std::string name = run.branch->at("parameter").at("name").get<std::string>();
    const std::string unit = run.branch->at("parameter").at("unit").get<std::string>();
    const int wanted = std::max(4, static_cast<int>(figure.width() / (7.0 * figure.font())));
    Panel panel(figure, figure.row(0.7 * figure.width()),
                plot_axis({name, unit == "1" ? std::string() : unit, false}, x_range[0], x_range[1], wanted),
                plot_axis(coordinate, y_range[0], y_range[1], 6));
    panel.open();
    // Long periods first, so that the few lines of short ones stay visible on top.
    for (auto period = periods.rbegin(); period != periods.rend(); ++period) {
        for (const Branch& one : branches) {
            if (branch_period(one) != *period) continue;
            Eigen::Index curves = 0;
            for (const BranchPoint& point : one.points)
                curves = std::max(curves, count_of(point, shown));
            for (Eigen::Index j = 0; j < curves; ++j)
                draw_curve(panel, one, shown, j, plot_marker(*period).colour);
        }
    }
    for (const Mark& mark : marks) {
        std::vector<double> x;
        std::vector<double> y;
        for (const BranchPlace& place : places) {
            const BranchPoint& point = branches[place.branch].points[place.point];
            if (point.bifurcation != mark.bifurcation) continue;
            for (Eigen::Index j = 0; j < count_of(point, shown); ++j) {
                x.push_back(point.parameter);
                y.push_back(value_of(point, shown, j));
            }
        }
        panel.markers(x, y, PlotMarker{"#1d2430", series_marker(mark.shape, radius).outline}, Panel::Filling::open);
    }
    panel.frame();
    return figure.svg("Branches of periodic orbits", fmt::format("{} branches over {}, {} orbits, {} bifurcations",
                                                                 branches.size(), name, orbits, places.size()));
}

}  // namespace orbid::apps::catalog
