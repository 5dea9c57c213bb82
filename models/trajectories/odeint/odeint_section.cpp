#include "models/trajectories/odeint/odeint_section.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace orbid::models {

namespace {

/// Entries of several angles that are not whole multiples of the smallest have no common turn.
double turn_of(const Kernel& kernel, const SectionPlane& plane) {
    constexpr double none = std::numeric_limits<double>::infinity();
    const auto table = kernel.coordinates();
    double smallest = none;
    for (std::size_t i = 0; i < table.size(); ++i)
        if (table[i].angle && plane.normal[i] != 0.0) smallest = std::min(smallest, std::abs(plane.normal[i]));
    for (std::size_t i = 0; i < table.size() && smallest < none; ++i) {
        const double multiple = plane.normal[i] / smallest;
        if (table[i].angle && std::abs(multiple - std::round(multiple)) > 1e-12 * std::abs(multiple)) return none;
    }
    return 2.0 * std::numbers::pi * smallest;
}

}  // namespace

OdeintSection::OdeintSection(const Kernel& kernel, const FlowStart& start, const SectionPlane& plane,
                             OdeintSolution& solution)
    : kernel_(kernel),
      start_(start),
      plane_(plane),
      solution_(solution),
      turn_(turn_of(kernel, plane)),
      f_(kernel.coordinates().size()) {
    end_ = look(solution_.end_state(), solution_.end());
}

OdeintSection::View OdeintSection::look(const std::vector<double>& y, double s) {
    kernel_.rhs(0.0, y.data(), start_.theta, nullptr, f_.data());
    View view{s, -plane_.offset, 0.0, std::abs(plane_.offset)};
    for (std::size_t i = 0; i < f_.size(); ++i) {
        view.g += plane_.normal[i] * y[i];
        view.terms += std::abs(plane_.normal[i] * y[i]);
        view.slope += plane_.normal[i] * f_[i];
    }
    view.g *= plane_.direction;
    view.slope *= plane_.direction;
    return view;
}

std::optional<OdeintSection::Crossing> OdeintSection::next(double latest) {
    while (found_.empty() && status_ == FlowStatus::ok) {
        if (!(solution_.end() < latest)) {
            status_ = FlowStatus::no_crossing;
            break;
        }
        View begin = end_;
        status_ = solution_.step();
        if (status_ != FlowStatus::ok) break;
        end_ = look(solution_.end_state(), solution_.end());
        rounding_ = 1e-14 * std::max(begin.terms, end_.terms);
        if (!started_) {
            // A start within rounding of the plane is taken as lying on it.
            started_ = true;
            const double level = std::isfinite(turn_) ? turn_ * std::round(begin.g / turn_) : 0.0;
            if (std::abs(begin.g - level) <= rounding_) begin.g = level;
        }
        search(begin, end_);
    }
    if (found_.empty()) return std::nullopt;
    if (found_.front().time > latest) {
        status_ = FlowStatus::no_crossing;
        return std::nullopt;
    }
    Crossing first = std::move(found_.front());
    found_.erase(found_.begin());
    return first;
}

/// Rises of g within a step, over which g turns once at most: its steps are short beside those of the solution's bends.
void OdeintSection::search(const View& a, const View& b) {
    if ((a.slope > 0.0) == (b.slope > 0.0)) return search_rise(a, b);
    const View turn = turning_point(a, b);
    // Whether a plane is passed at the turning point is decided by rounding; leaving a start on the plane is no touch.
    const double level = std::isfinite(turn_) ? turn_ * std::round(turn.g / turn_) : 0.0;
    if (std::abs(turn.g - level) <= rounding_ && turn.s > 0.0 && a.g != level) {
        status_ = FlowStatus::grazing;
        return;
    }
    search_rise(a, turn);
    search_rise(turn, b);
}

void OdeintSection::search_rise(const View& a, const View& b) {
    if (!(a.g < b.g)) return;
    if (!std::isfinite(turn_)) {
        if (a.g < 0.0 && b.g >= 0.0) locate(a, b, 0.0);
        return;
    }
    for (double k = std::floor(a.g / turn_) + 1.0; k * turn_ <= b.g && status_ == FlowStatus::ok; ++k)
        if (k * turn_ > a.g) locate(a, b, k * turn_);
}

/// Where dg/ds changes sign, by bisection.
OdeintSection::View OdeintSection::turning_point(const View& a, const View& b) {
    View lo = a, hi = b;
    for (int i = 0; i < 60 && hi.s - lo.s > 1e-12 * (b.s - a.s); ++i) {
        const double s = 0.5 * (lo.s + hi.s);
        if (!(lo.s < s && s < hi.s)) break;
        const View middle = view_at(s);
        ((middle.slope > 0.0) == (a.slope > 0.0) ? lo : hi) = middle;
    }
    return lo;
}

/// Zero of g - level between both: Newton's method on s, held inside the bracket by bisection.
void OdeintSection::locate(View below, View above, double level) {
    const double length = above.s - below.s, bend = std::abs(above.slope - below.slope) / length;
    double s = below.s + length * (level - below.g) / (above.g - below.g);
    View at;
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

}  // namespace orbid::models
