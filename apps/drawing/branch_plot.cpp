#include "apps/drawing/branch_plot.hpp"

#include <algorithm>
#include <array>
#include <numbers>
#include <set>
#include <string_view>

#include "apps/drawing/figure.hpp"
#include "apps/results/followed_branch.hpp"

namespace orbid::apps {

namespace {

using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchPoint;

struct Mark {
    Bifurcation bifurcation;
    std::string_view name;
    std::size_t shape;  ///< of series_marker
};

constexpr std::array<Mark, 4> marks{{{Bifurcation::period_doubling, "period doubling", 0},
                                     {Bifurcation::fold, "fold", 1},
                                     {Bifurcation::branch_point, "branch point (symmetry breaking)", 3},
                                     {Bifurcation::neimark_sacker, "Neimark-Sacker", 2}}};
constexpr std::string_view dashes = "2.2 1.6";

/// Open shapes, so that the lines below stay visible.
PlotMarker open_mark(const Mark& mark, double radius) {
    return {"#1d2430", series_marker(mark.shape, radius).outline};
}

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
void draw_curve(Panel& panel, const Branch& branch, const Values& values, Eigen::Index j, std::string_view colour) {
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
            y.push_back(values.at(points[i], j));
        }
        panel.curve(x, y, {colour, stable ? 1.0 : 0.7, stable ? std::string_view() : dashes});
        k = end;
    }
}

void draw_branches(Panel& panel, const std::vector<Branch>& branches, const Values& values,
                   const std::set<int>& periods) {
    // Long periods first, so that the few lines of short ones stay visible on top.
    for (auto period = periods.rbegin(); period != periods.rend(); ++period) {
        for (const Branch& branch : branches) {
            if (branch_period(branch) != *period) continue;
            Eigen::Index curves = 0;
            for (const BranchPoint& point : branch.points)
                curves = std::max(curves, values.count(point));
            for (Eigen::Index j = 0; j < curves; ++j)
                draw_curve(panel, branch, values, j, plot_marker(*period).colour);
        }
    }
}

void draw_bifurcations(Panel& panel, const std::vector<const BranchPoint*>& located, const Values& values,
                       double radius) {
    for (const Mark& mark : marks) {
        std::vector<double> x;
        std::vector<double> y;
        for (const BranchPoint* point : located) {
            if (point->bifurcation != mark.bifurcation) continue;
            for (Eigen::Index j = 0; j < values.count(*point); ++j) {
                x.push_back(point->parameter);
                y.push_back(values.at(*point, j));
            }
        }
        panel.markers(x, y, open_mark(mark, radius), Panel::Filling::open);
    }
}

std::vector<LegendEntry> legend_of(const std::set<int>& periods, const std::vector<const BranchPoint*>& located,
                                   double radius) {
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
    legend.push_back({"unstable", LegendEntry::Kind::line, {}, {"#39424f", 0.8, dashes}});
    for (const Mark& mark : marks) {
        if (std::any_of(located.begin(), located.end(),
                        [&](const auto* p) { return p->bifurcation == mark.bifurcation; }))
            legend.push_back({std::string(mark.name), LegendEntry::Kind::marker, open_mark(mark, radius), {}, true});
    }
    return legend;
}

}  // namespace

std::string branches_svg(const std::vector<Branch>& branches, const BranchPicture& picture, const PlotStyle& style) {
    const Values values{picture.shown};
    PlotRange x_range, y_range;
    std::set<int> periods;
    std::size_t orbits = 0;
    for (const Branch& branch : branches) {
        periods.insert(branch_period(branch));
        orbits += branch.points.size();
        for (const BranchPoint& point : branch.points) {
            x_range.include(point.parameter);
            for (Eigen::Index j = 0; j < values.count(point); ++j)
                y_range.include(values.at(point, j));
        }
    }
    std::vector<const BranchPoint*> located;
    for (const BranchPlace& place : located_bifurcations(branches))
        located.push_back(&branches[place.branch].points[place.point]);
    // Branches fill a small part of the circle: an angle that stays away from the cut has an axis of its own.
    constexpr double quarter = 0.5 * std::numbers::pi;
    orbits::SeriesCoordinate upwards = picture.coordinate;
    upwards.angle = upwards.angle && !(y_range.lowest > -quarter && y_range.highest < quarter);

    const std::string description =
        fmt::format("{} branch{} over {}, {} orbits, {} bifurcations located", branches.size(),
                    branches.size() == 1 ? "" : "es", picture.parameter.name, orbits, located.size());
    Figure figure(style);
    figure.title(picture.heading, description);
    const double radius = 0.26 * figure.font() * style.marks;
    figure.legend(legend_of(periods, located, radius));
    Panel panel(figure, figure.row(0.7 * style.height * figure.width()),
                plot_axis(picture.parameter, x_range, figure.wanted_ticks()), plot_axis(upwards, y_range, 6));
    panel.open();
    draw_branches(panel, branches, values, periods);
    draw_bifurcations(panel, located, values, radius);
    panel.frame();
    return figure.svg(picture.title, description);
}

}  // namespace orbid::apps
