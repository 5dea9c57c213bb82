#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "models/trajectories/odeint/odeint_solution.hpp"

namespace orbid::models {

/// Crossings of a plane in one direction by a solution of an autonomous model:
///
///     g(x) = direction (normal . x - offset)   rises through 0, or through the same after full turns of an angle
///
/// as SectionCrossing has them. The solution takes the steps that it would take without a section; crossings are
/// located on the interpolant of the step that passes them.
class OdeintSection {
public:
    struct Crossing {
        double time;
        std::vector<double> y;  ///< layout of VariationalEquations, its derivatives at a fixed time
        std::vector<double> f;  ///< x' there
    };

    /// A start on the plane is no crossing, nor is one that rounding has put a little below it. All must outlive this.
    OdeintSection(const Kernel& kernel, const FlowStart& start, const SectionPlane& plane, OdeintSolution& solution)
        : kernel_(kernel),
          theta_(start.theta),
          plane_(plane),
          solution_(solution),
          turn_(turn_of(plane, kernel.coordinates())),
          f_(kernel.coordinates().size()) {
        end_ = view_at(solution_.end());
    }

    /// The next crossing, not later than `latest`; otherwise status() says why there is none.
    [[nodiscard]] std::optional<Crossing> next(double latest) {
        while (found_.empty() && status_ == FlowStatus::ok) {
            if (!(solution_.end() < latest)) {
                status_ = FlowStatus::no_crossing;
                break;
            }
            PlaneView begin = end_;
            status_ = solution_.step();
            if (status_ != FlowStatus::ok) break;
            end_ = view_at(solution_.end());
            rounding_ = 1e-14 * std::max(begin.terms, end_.terms);
            // A start within rounding of the plane is taken as lying on it.
            const double level = nearest_level(begin.g, turn_);
            if (!started_ && std::abs(begin.g - level) <= rounding_) begin.g = level;
            started_ = true;
            search(begin, end_);
        }
        if (!found_.empty() && found_.front().time > latest) status_ = FlowStatus::no_crossing;
        if (found_.empty() || found_.front().time > latest) return std::nullopt;
        Crossing first = std::move(found_.front());
        found_.erase(found_.begin());
        return first;
    }
    /// ok while crossings are found; then no_crossing, grazing, or what ended the solution.
    [[nodiscard]] FlowStatus status() const { return status_; }

private:
    /// Leaves x' there in f_.
    [[nodiscard]] PlaneView view_at(double s) {
        const std::vector<double> y = solution_.at(s);
        kernel_.rhs(0.0, y.data(), theta_, nullptr, f_.data());
        return view_from(plane_, s, y, f_);
    }

    /// Rises of g within a step, over which g turns once at most: its steps are short beside those of the solution's
    /// bends.
    void search(const PlaneView& a, const PlaneView& b) {
        if ((a.slope > 0.0) == (b.slope > 0.0)) return search_rise(a, b);
        const PlaneView turn = turning_point(a, b);
        // Whether a plane is passed at the turning point is decided by rounding; leaving a start on the plane is no
        // touch.
        const double level = nearest_level(turn.g, turn_);
        if (std::abs(turn.g - level) <= rounding_ && turn.s > 0.0 && a.g != level) {
            status_ = FlowStatus::grazing;
            return;
        }
        search_rise(a, turn);
        search_rise(turn, b);
    }

    void search_rise(const PlaneView& a, const PlaneView& b) {
        if (!(a.g < b.g)) return;
        if (!std::isfinite(turn_)) {
            if (a.g < 0.0 && b.g >= 0.0) locate(a, b, 0.0);
            return;
        }
        for (double k = std::floor(a.g / turn_) + 1.0; k * turn_ <= b.g && status_ == FlowStatus::ok; ++k)
            if (k * turn_ > a.g) locate(a, b, k * turn_);
    }

    /// Where dg/ds changes sign, by bisection.
    [[nodiscard]] PlaneView turning_point(const PlaneView& a, const PlaneView& b) {
        PlaneView lo = a, hi = b;
        for (int i = 0; i < 60 && hi.s - lo.s > 1e-12 * (b.s - a.s); ++i) {
            const double s = 0.5 * (lo.s + hi.s);
            if (!(lo.s < s && s < hi.s)) break;
            const PlaneView middle = view_at(s);
            ((middle.slope > 0.0) == (a.slope > 0.0) ? lo : hi) = middle;
        }
        return lo;
    }

    /// Zero of g - level between both: Newton's method on s, held inside the bracket by bisection.
    void locate(PlaneView below, PlaneView above, double level) {
        const double length = above.s - below.s, bend = std::abs(above.slope - below.slope) / length;
        double s = below.s + length * (level - below.g) / (above.g - below.g);
        PlaneView at;
        // Newton needs three or four; 100 is more than bisection needs to shrink any step to neighbouring doubles.
        for (int i = 0; i < 100; ++i) {
            if (!(below.s < s && s < above.s)) s = 0.5 * (below.s + above.s);
            at = view_at(s);
            (at.g < level ? below : above) = at;
            const double next = s - (at.g - level) / at.slope;
            const double resolution = 2.0 * std::numeric_limits<double>::epsilon() * s;
            if (std::abs(next - s) <= std::max(1e-13 * length, resolution) || !(above.s - below.s > resolution)) break;
            s = next;
        }
        // Without rounding g would pass the level by slope^2 / (2 bend): a touch when rounding decides.
        if (!(at.slope > 0.0) || at.slope * at.slope <= 2.0 * rounding_ * bend) {
            status_ = FlowStatus::grazing;
            return;
        }
        // f_ is that of the last view.
        found_.push_back({at.s, solution_.at(at.s), f_});
    }

    const Kernel& kernel_;
    const double* theta_;
    SectionPlane plane_;
    OdeintSolution& solution_;
    double turn_;  ///< change of g that leads from the plane to itself, infinity without angles
    PlaneView end_;
    bool started_ = false;
    double rounding_ = 0.0;  ///< of g in this step: 45 roundings of the terms that it is the sum of
    std::vector<double> f_;
    std::vector<Crossing> found_;  ///< in the present step, in time
    FlowStatus status_ = FlowStatus::ok;
};

}  // namespace orbid::models
