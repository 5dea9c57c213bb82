#include "apps/drawing/branch_plot.hpp"

#include <algorithm>
#include <array>
#include <numbers>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "apps/results/counted_noun.hpp"
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

/// What is drawn upwards: one value per point of the section, or T or a measure alone.
struct Values {
    std::optional<Eigen::Index> shown;
    std::optional<periodic::OrbitMeasure> measure;

    [[nodiscard]] Eigen::Index count(const BranchPoint& point) const {
        return shown && !measure ? point.orbit.points.cols() : 1;
    }
    [[nodiscard]] double at(const BranchPoint& point, Eigen::Index j) const {
        if (measure) return measure_of(point, *measure, shown.value_or(0));
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

void add_bands(const std::vector<BranchBand>& bands, ChartView& view) {
    for (const BranchBand& band : bands) {
        ChartLayer layer{LayerKind::band, "95 % band", 1};
        layer.x = band.x;
        layer.lower = band.lower;
        layer.upper = band.upper;
        view.add(std::move(layer));
    }
}

/// Filled where the model's orbit is stable, open where it is not, soft where there is none.
void add_measured(const std::vector<MeasuredMark>& motions, ChartView& view) {
    ChartLayer stable{LayerKind::points, "measured, stable", 6, Ink::ink};
    ChartLayer unstable{LayerKind::points, "measured, unstable", 6, Ink::ink};
    ChartLayer without{LayerKind::points, "measured, no orbit of the model", 6, Ink::soft};
    ChartLayer errors{LayerKind::intervals, "95 % interval of the measured value", 1, Ink::soft};
    unstable.open = without.open = true;
    for (const MeasuredMark& one : motions) {
        ChartLayer& layer = !one.stable ? without : *one.stable ? stable : unstable;
        layer.add(one.x, one.value);
        layer.labels.push_back(one.label);
        if (!(one.lower < one.upper)) continue;
        errors.x.push_back(one.x);
        errors.lower.push_back(one.lower);
        errors.upper.push_back(one.upper);
    }
    view.add(std::move(errors));
    view.add(std::move(stable));
    view.add(std::move(unstable));
    view.add(std::move(without));
}

}  // namespace

Chart branch_chart(const std::vector<Branch>& branches, const BranchPicture& picture) {
    const Values values{picture.shown, picture.measure};
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
    add_bands(picture.bands, view);
    // Long periods first, so that the few lines of short ones stay visible on top.
    for (auto period = periods.rbegin(); period != periods.rend(); ++period)
        add_lines(branches, *period, values, picture.coordinate.angle, view);
    add_marks(located, values, picture.coordinate.angle, view);
    add_measured(picture.measured, view);
    ChartRange x, y;
    for (const ChartLayer& layer : view.layers) {
        x.include(layer.x);
        y.include(layer.y);
        y.include(layer.lower);
        y.include(layer.upper);
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

void show_measure(periodic::OrbitMeasure measure, BranchPicture& picture) {
    picture.measure = measure;
    const std::string& name = periodic::name_of(measure);
    if (measure == periodic::OrbitMeasure::frequency) {
        picture.shown.reset();
        picture.coordinate = {name, "Hz", false};
    } else {
        picture.coordinate = {picture.coordinate.name + "." + name, picture.coordinate.unit, false};
    }
}

namespace {

/// What a name like "h.half_range" says, of coordinates and readings in this order; nothing for one of neither.
bool take_measure(const std::string& name, const std::vector<orbits::SeriesCoordinate>& quantities,
                  BranchPicture& picture) {
    using periodic::OrbitMeasure;
    for (int m = 0; m <= static_cast<int>(OrbitMeasure::frequency); ++m) {
        const auto measure = static_cast<OrbitMeasure>(m);
        const std::string& word = periodic::name_of(measure);
        picture.measure = measure;
        picture.shown.reset();
        if (measure == OrbitMeasure::frequency) return name == word;
        for (std::size_t i = 0; i < quantities.size(); ++i) {
            picture.shown = static_cast<Eigen::Index>(i);
            if (name == quantities[i].name + "." + word) return true;
        }
    }
    return false;
}

}  // namespace

Chart measure_chart(const FollowedBranches& followed, const orbits::SeriesCoordinate& parameter,
                    const std::vector<orbits::SeriesCoordinate>& coordinates, const BranchBands& bands) {
    constexpr double normal95 = 1.959963984540054;
    std::vector<orbits::SeriesCoordinate> quantities = coordinates;
    quantities.insert(quantities.end(), followed.readings.begin(), followed.readings.end());
    Chart chart{"branch", "Measures of periodic motions over the parameter", "Measure"};
    chart.arrangement = Chart::Arrangement::stacked;
    std::vector<std::string> measures;
    for (const MeasuredMotion& motion : followed.measured)
        for (const MeasuredMotion::Value& one : motion.values)
            if (std::find(measures.begin(), measures.end(), one.name) == measures.end()) measures.push_back(one.name);
    for (const auto& [name, own] : bands)
        if (followed.measured.empty()) measures.push_back(name);
    for (const std::string& measure : measures) {
        BranchPicture picture;
        picture.parameter = parameter;
        if (!take_measure(measure, quantities, picture)) continue;
        const std::string unit = picture.shown ? quantities[static_cast<std::size_t>(*picture.shown)].unit : "Hz";
        picture.coordinate = {measure, unit == "1" ? "" : unit, false};
        if (const auto own = bands.find(measure); own != bands.end()) picture.bands = own->second;
        for (const MeasuredMotion& motion : followed.measured)
            for (const MeasuredMotion::Value& one : motion.values) {
                if (one.name != measure) continue;
                std::optional<bool> stable;
                if (motion.unstable) stable = *motion.unstable == 0;
                picture.measured.push_back({motion.parameter, one.observed, one.observed - normal95 * one.sd,
                                            one.observed + normal95 * one.sd, stable, motion.label});
            }
        Chart view = branch_chart(followed.branches, picture);
        chart.views.push_back(std::move(view.views.front()));
        chart.description = view.description;
    }
    if (!followed.measured.empty())
        chart.description += fmt::format(", {} measured", counted(followed.measured.size(), "motion"));
    if (followed.pieces.size() > 1)
        chart.description += fmt::format("; the branch is in {} pieces", followed.pieces.size());
    return chart;
}

}  // namespace orbid::apps
