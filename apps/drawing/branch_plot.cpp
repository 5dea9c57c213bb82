#include "apps/drawing/branch_plot.hpp"

#include <algorithm>
#include <array>
#include <numbers>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "apps/results/followed_branch.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::apps {

namespace {

using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchPoint;

struct Mark {
    Bifurcation bifurcation;
    std::string_view name;
    int style;
};

constexpr std::array<Mark, 4> marks{{{Bifurcation::period_doubling, "period doubling", 1},
                                     {Bifurcation::fold, "fold", 2},
                                     {Bifurcation::branch_point, "branch point (symmetry breaking)", 4},
                                     {Bifurcation::neimark_sacker, "Neimark-Sacker", 3}}};

/// What is drawn upwards: one value per point of the section, or T alone.
struct Values {
    std::optional<Eigen::Index> shown;

    [[nodiscard]] Eigen::Index count(const BranchPoint& point) const { return shown ? point.orbit.points.cols() : 1; }
    [[nodiscard]] double at(const BranchPoint& point, Eigen::Index j) const {
        // The orbit that a doubled branch begins with has half as many points.
        return shown ? point.orbit.points(*shown, j % point.orbit.points.cols()) : point.orbit.time;
    }
};

/// The orbits between point k and the next one are stable. At a bifurcation a multiplier is on the unit circle, and
/// rounding decides on which side: the ordinary neighbour says what lies between.
bool stable_after(const std::vector<BranchPoint>& points, std::size_t k) {
    return (points[k].bifurcation == Bifurcation::none ? points[k] : points[k + 1]).unstable == 0;
}

/// The curve that point j of the orbits draws, in stable and unstable pieces.
void add_curve(const Branch& branch, const Values& values, Eigen::Index j, bool angle, ChartLayer& stable,
               ChartLayer& unstable) {
    const auto& points = branch.points;
    for (std::size_t k = 0; k + 1 < points.size();) {
        const bool is_stable = stable_after(points, k);
        std::size_t end = k + 1;
        while (end + 1 < points.size() && stable_after(points, end) == is_stable)
            ++end;
        ChartLayer& line = is_stable ? stable : unstable;
        for (std::size_t i = k; i <= end; ++i)
            line.follow(points[i].parameter, values.at(points[i], j), angle);
        line.lift();
        k = end;
    }
}

/// All branches of one period: first the unstable orbits, then the stable ones.
void add_lines(const std::vector<Branch>& branches, int period, const Values& values, bool angle, ChartView& view) {
    ChartLayer stable{LayerKind::line, fmt::format("period {}", period), std::min(period, 8)};
    ChartLayer unstable{LayerKind::line, "unstable", stable.style};
    unstable.dash = true;
    for (const Branch& branch : branches) {
        if (branch_period(branch) != period) continue;
        Eigen::Index curves = 0;
        for (const BranchPoint& point : branch.points)
            curves = std::max(curves, values.count(point));
        for (Eigen::Index j = 0; j < curves; ++j)
            add_curve(branch, values, j, angle, stable, unstable);
    }
    view.add(std::move(unstable));
    view.add(std::move(stable));
}

void add_marks(const std::vector<const BranchPoint*>& located, const Values& values, bool angle, ChartView& view) {
    for (const Mark& mark : marks) {
        // Open shapes, so that the lines below stay visible.
        ChartLayer layer{LayerKind::points, std::string(mark.name), mark.style, Ink::ink};
        layer.open = true;
        for (const BranchPoint* point : located) {
            if (point->bifurcation != mark.bifurcation) continue;
            for (Eigen::Index j = 0; j < values.count(*point); ++j) {
                const double value = values.at(*point, j);
                layer.add(point->parameter, angle ? models::wrapped(value) : value);
                layer.labels.push_back(fmt::format("{}, period {}", mark.name, point->orbit.period));
            }
        }
        view.add(std::move(layer));
    }
}

}  // namespace

Chart branch_chart(const std::vector<Branch>& branches, const BranchPicture& picture) {
    const Values values{picture.shown};
    std::set<int> periods;
    std::size_t orbits = 0;
    for (const Branch& branch : branches) {
        periods.insert(branch_period(branch));
        orbits += branch.points.size();
    }
    std::vector<const BranchPoint*> located;
    for (const BranchPlace& place : located_bifurcations(branches))
        located.push_back(&branches[place.branch].points[place.point]);
    ChartView view;
    // Long periods first, so that the few lines of short ones stay visible on top.
    for (auto period = periods.rbegin(); period != periods.rend(); ++period)
        add_lines(branches, *period, values, picture.coordinate.angle, view);
    add_marks(located, values, picture.coordinate.angle, view);
    ChartRange x, y;
    for (const ChartLayer& layer : view.layers) {
        x.include(layer.x);
        y.include(layer.y);
    }
    // Branches fill a small part of the circle: an angle that stays away from the cut has an axis of its own.
    constexpr double quarter = 0.5 * std::numbers::pi;
    orbits::SeriesCoordinate upwards = picture.coordinate;
    upwards.angle = upwards.angle && !(y.lowest > -quarter && y.highest < quarter);
    view.label = display_name(upwards.name);
    view.x = x.axis(picture.parameter);
    view.y = y.axis(upwards);
    view.height = 0.6;
    Chart chart{"branch", picture.title, "Coordinate", {}};
    chart.views.push_back(std::move(view));
    chart.description = fmt::format("{} branch{} over {}, {} orbits, {} bifurcations located", branches.size(),
                                    branches.size() == 1 ? "" : "es", picture.parameter.name, orbits, located.size());
    return chart;
}

}  // namespace orbid::apps
