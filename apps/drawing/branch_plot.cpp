#include "apps/drawing/branch_plot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

#include "apps/drawing/plot_frame.hpp"
#include "apps/drawing/plot_marker.hpp"
#include "apps/results/followed_branch.hpp"

namespace orbid::apps {

namespace {

using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchPoint;
using Out = std::back_insert_iterator<fmt::memory_buffer>;

/// A vertex nearer than this to the one before cannot be seen [px].
constexpr double visible_px = 0.5;

struct Mark {
    Bifurcation bifurcation;
    std::string_view name;
    std::string_view outline;  ///< SVG path data relative to the centre
};

/// Open shapes, so that the lines below stay visible.
constexpr std::array<Mark, 4> marks{
    {{Bifurcation::period_doubling, "period doubling", "m-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0z"},
     {Bifurcation::fold, "fold", "m-4.5 -4.5h9v9h-9z"},
     {Bifurcation::branch_point, "branch point (symmetry breaking)", "m0 -6l6 6l-6 6l-6 -6z"},
     {Bifurcation::neimark_sacker, "Neimark-Sacker", "m0 -6l5.5 9.5h-11z"}}};

/// What is drawn upwards: one value per point of the section, or T alone.
class Values {
public:
    Values(const std::vector<orbits::SeriesCoordinate>& coordinates, const BranchPlotOptions& options)
        : shown_(options.shown) {
        if (!shown_) {
            axis_ = {"T", "s", false};
            return;
        }
        if (!(*shown_ >= 0 && *shown_ < static_cast<Eigen::Index>(coordinates.size())))
            throw std::invalid_argument(
                fmt::format("branch plot: coordinate {}, must be in [0, {})", *shown_, coordinates.size()));
        axis_ = coordinates[static_cast<std::size_t>(*shown_)];
    }

    [[nodiscard]] Eigen::Index count(const BranchPoint& point) const { return shown_ ? point.orbit.points.cols() : 1; }
    [[nodiscard]] Eigen::Index curves(const Branch& branch) const {
        Eigen::Index most = 0;
        for (const BranchPoint& point : branch.points)
            most = std::max(most, count(point));
        return most;
    }
    [[nodiscard]] double at(const BranchPoint& point, Eigen::Index j) const {
        // The orbit that a doubled branch begins with has half as many points.
        return shown_ ? point.orbit.points(*shown_, j % point.orbit.points.cols()) : point.orbit.time;
    }
    [[nodiscard]] const orbits::SeriesCoordinate& coordinate() const { return axis_; }

private:
    std::optional<Eigen::Index> shown_;
    orbits::SeriesCoordinate axis_;
};

PlotFrame branch_frame(const std::vector<Branch>& branches, const models::Parameter& parameter, const Values& values) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    std::array<double, 2> x{infinity, -infinity};
    std::array<double, 2> y{infinity, -infinity};
    for (const Branch& branch : branches) {
        for (const BranchPoint& point : branch.points) {
            x = {std::min(x[0], point.parameter), std::max(x[1], point.parameter)};
            for (Eigen::Index j = 0; j < values.count(point); ++j)
                y = {std::min(y[0], values.at(point, j)), std::max(y[1], values.at(point, j))};
        }
    }
    const std::string unit = parameter.unit == "1" ? std::string() : std::string(parameter.unit);
    PlotFrame frame{plot_axis({std::string(parameter.name), unit, false}, x[0], x[1]),
                    plot_axis(values.coordinate(), y[0], y[1])};
    // Branches fill a small part of the circle: an angle that stays away from the cut has an axis of its own.
    constexpr double half_circle = 1.5707963267948966;
    if (values.coordinate().angle && y[0] > -half_circle && y[1] < half_circle) {
        orbits::SeriesCoordinate plain = values.coordinate();
        plain.angle = false;
        frame.y_axis = plot_axis(plain, y[0], y[1]);
    }
    return frame;
}

/// The orbits between point k and the next one are stable. At a bifurcation a multiplier is on the unit circle, and
/// rounding decides on which side: the ordinary neighbour says what lies between.
bool stable_after(const std::vector<BranchPoint>& points, std::size_t k) {
    const BranchPoint& said = points[k].bifurcation == Bifurcation::none ? points[k] : points[k + 1];
    return said.unstable == 0;
}

/// The curve that point j of the orbits draws, in stable and unstable pieces.
void draw_curve(const Branch& branch, Eigen::Index j, const Values& values, const PlotFrame& frame, Out out) {
    const auto& points = branch.points;
    const double half_turn = frame.y_axis.circle ? 3.141592653589793 : std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k + 1 < points.size();) {
        const bool stable = stable_after(points, k);
        std::size_t end = k + 1;
        while (end + 1 < points.size() && stable_after(points, end) == stable)
            ++end;
        fmt::format_to(out, "<path{} d=\"", stable ? "" : " stroke-dasharray=\"5 4\"");
        double last_x = 0.0;
        double last_y = 0.0;
        for (std::size_t i = k; i <= end; ++i) {
            const double x = frame.x(points[i].parameter);
            const double y = frame.y(values.at(points[i], j));
            const bool jump = i == k || std::abs(values.at(points[i], j) - values.at(points[i - 1], j)) > half_turn;
            if (!jump && i != end && std::hypot(x - last_x, y - last_y) < visible_px) continue;
            fmt::format_to(out, "{}{:.1f} {:.1f}", jump ? "M" : "L", x, y);
            last_x = x;
            last_y = y;
        }
        fmt::format_to(out, "\"/>\n");
        k = end;
    }
}

/// Long periods first, so that the few lines of short ones stay visible on top.
void draw_branches(const std::vector<Branch>& branches, const std::set<int>& periods, const Values& values,
                   const PlotFrame& frame, Out out) {
    for (auto period = periods.rbegin(); period != periods.rend(); ++period) {
        fmt::format_to(out, "<g fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\" stroke-linejoin=\"round\">\n",
                       plot_marker(*period).colour);
        for (const Branch& branch : branches) {
            if (branch_period(branch) != *period) continue;
            for (Eigen::Index j = 0; j < values.curves(branch); ++j)
                draw_curve(branch, j, values, frame, out);
        }
        fmt::format_to(out, "</g>\n");
    }
}

/// @return which kinds of bifurcations there are.
std::set<Bifurcation> draw_bifurcations(const std::vector<Branch>& branches, const Values& values,
                                        const PlotFrame& frame, Out out) {
    std::set<Bifurcation> kinds;
    fmt::format_to(out, "<g fill=\"#ffffff\" fill-opacity=\".7\" stroke=\"#1d2430\" stroke-width=\"1.3\">\n");
    for (const BranchPlace& place : located_bifurcations(branches)) {
        const BranchPoint& point = branches[place.branch].points[place.point];
        const auto mark =
            std::find_if(marks.begin(), marks.end(), [&](const Mark& m) { return m.bifurcation == point.bifurcation; });
        if (mark == marks.end()) continue;
        kinds.insert(point.bifurcation);
        for (Eigen::Index j = 0; j < values.count(point); ++j)
            fmt::format_to(out, "<path d=\"M{:.1f} {:.1f}{}\"/>\n", frame.x(point.parameter),
                           frame.y(values.at(point, j)), mark->outline);
    }
    fmt::format_to(out, "</g>\n");
    return kinds;
}

void draw_branch_legend(const std::set<int>& periods, const std::set<Bifurcation>& kinds, Out out) {
    fmt::format_to(out, "<g font-size=\"14\" fill=\"#1d2430\">\n");
    constexpr double baseline = 91.0;
    constexpr double letter = 7.2;  // px of an average letter of 14 px
    double x = PlotFrame::left + 8.0;
    const auto line = [&](std::string_view text, std::string_view style) {
        fmt::format_to(out, "<path fill=\"none\" stroke-width=\"2\" {} d=\"M{:.1f} {:.1f}h22\"/>\n", style, x,
                       baseline - 5.0);
        fmt::format_to(out, "<text x=\"{:.1f}\" y=\"{}\">{}</text>\n", x + 27.0, baseline, text);
        x += 27.0 + letter * static_cast<double>(text.size()) + 14.0;
    };
    for (const int period : periods) {
        // Periods from 8 on share one colour.
        const bool several = period >= 8 && period != *periods.rbegin();
        line(several ? fmt::format("period {} ...", period) : fmt::format("period {}", period),
             fmt::format("stroke=\"{}\"", plot_marker(period).colour));
        if (several) break;
    }
    line("unstable", "stroke=\"#39424f\" stroke-dasharray=\"5 4\"");
    for (const Mark& mark : marks) {
        if (!kinds.contains(mark.bifurcation)) continue;
        fmt::format_to(out, "<path fill=\"none\" stroke=\"#1d2430\" stroke-width=\"1.3\" d=\"M{:.1f} {:.1f}{}\"/>\n",
                       x + 6.0, baseline - 5.0, mark.outline);
        fmt::format_to(out, "<text x=\"{:.1f}\" y=\"{}\">{}</text>\n", x + 17.0, baseline, mark.name);
        x += 17.0 + letter * static_cast<double>(mark.name.size()) + 12.0;
    }
    fmt::format_to(out, "</g>\n");
}

}  // namespace

std::string branches_svg(const std::vector<Branch>& branches, const models::Parameter& parameter,
                         const std::vector<orbits::SeriesCoordinate>& coordinates, const BranchPlotOptions& options) {
    const Values values(coordinates, options);
    const PlotFrame frame = branch_frame(branches, parameter, values);
    std::set<int> periods;
    std::size_t points = 0;
    for (const Branch& branch : branches) {
        points += branch.points.size();
        periods.insert(branch_period(branch));
    }
    const std::string title = options.title.empty() ? "Branches of periodic orbits" : options.title;
    const std::string subtitle =
        fmt::format("{} branch{}, {} orbits, {} bifurcations located", branches.size(),
                    branches.size() == 1 ? "" : "es", points, located_bifurcations(branches).size());
    fmt::memory_buffer buffer;
    const Out out(buffer);
    fmt::format_to(out, "{}{}", frame.head(title, subtitle), frame.grid());
    fmt::format_to(out, "{}", frame.border());
    draw_branches(branches, periods, values, frame, out);
    const auto kinds = draw_bifurcations(branches, values, frame, out);
    draw_branch_legend(periods, kinds, out);
    fmt::format_to(out, "</svg>\n");
    return fmt::to_string(buffer);
}

}  // namespace orbid::apps
