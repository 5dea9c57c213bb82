#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "models/arithmetic/cubic_zero.hpp"
#include "models/trajectories/flow.hpp"

namespace orbid::models {

/// Crossings of a plane in one direction by an autonomous flow, with N directions of derivative.
///
///     g(x) = direction (normal . x - offset)   rises through 0: a crossing
///
/// A coordinate that is an angle makes the plane recur. With every full turn g changes by 2 pi times its entry of the
/// normal, and each of the parallel planes counts, as a section of a circle requires. Entries of several angles that
/// have no common turn: the plane is one in the space of unwrapped angles.
///
/// The trajectory takes the same steps as without a section. Within a step g is bracketed between points of the
/// solution, each reached from a copy of the trajectory at the start of the step. A crossing is therefore as accurate
/// as any other state, and its place does not disturb what follows. A jump of the state over the plane (impact) is no
/// crossing.
template <Model M, std::size_t N>
class SectionCrossing {
public:
    using T = Scalar<N>;
    static constexpr std::size_t n = dimension_of<M>;
    using Path = TrajectoryOf<M, N>;
    using Point = State<T, n>;

    /// Point and time of a crossing; their partials say how both move with the start and the parameters.
    struct Crossing {
        Point state;
        T time;
    };

    /// A start on the plane, or one that rounding has put slightly below it, is no crossing.
    SectionCrossing(const SectionPlane& plane, Path& path, const M& model = M())
        : plane_(plane), path_(path), turn_(turn_of(plane, model.coordinates)) {
        end_ = look(path_);
    }

    /// The next crossing, not later than `latest`; otherwise status() says why there is none.
    [[nodiscard]] std::optional<Crossing> next(double latest) {
        while (found_.empty() && status_ == FlowStatus::ok) {
            if (!(path_.s() < latest)) {
                status_ = FlowStatus::no_crossing;
                break;
            }
            begin_ = end_;
            // A copy at the start of the step; copies of it look into the step.
            const Path before = path_;
            status_ = path_.step_towards(latest);
            if (status_ != FlowStatus::ok) break;
            end_ = look(path_);
            rounding_ = 1e-14 * std::max(begin_.terms, end_.terms);
            // A start within rounding of the plane is taken as lying on it.
            const double level = nearest_level(begin_.g, turn_);
            if (!started_ && std::abs(begin_.g - level) <= rounding_) begin_.g = level;
            started_ = true;
            before_ = &before;
            const View last = smooth_end(before);
            search(begin_, last, 0);
            if (last.s < end_.s && status_ == FlowStatus::ok) search_levels(last, end_, false, false, last.g, end_.g);
            before_ = nullptr;
        }
        if (found_.empty()) return std::nullopt;
        Crossing first = found_.front();
        found_.erase(found_.begin());
        return first;
    }
    /// ok while crossings are found. Then no_crossing, grazing, or what ended the solution. Grazing: up to rounding the
    /// plane is touched without being crossed, so the crossing and its derivatives are undetermined.
    [[nodiscard]] FlowStatus status() const { return found_.empty() ? status_ : FlowStatus::ok; }

private:
    struct View : PlaneView {
        State<double, n> f{};
    };

    [[nodiscard]] View look(Path& path) const {
        View view;
        view.f = values_of<N, n>(path.slope());
        static_cast<PlaneView&>(view) = view_from(plane_, path.s(), path.state(), view.f);
        return view;
    }

    /// Instants this close count as neighbouring doubles.
    [[nodiscard]] static double resolution(double s) { return 2.0 * std::numeric_limits<double>::epsilon() * s; }

    /// Copy of the trajectory at s inside the present step.
    [[nodiscard]] std::optional<Path> path_at(double s) {
        Path copy = *before_;
        const FlowStatus status = copy.advance(s);
        if (status == FlowStatus::ok) return copy;
        status_ = status;
        return std::nullopt;
    }
    [[nodiscard]] std::optional<View> view_at(double s) {
        auto path = path_at(s);
        return path ? std::optional(look(*path)) : std::nullopt;
    }

    /// The end of the step, before the event that ended it, if any: there the slope jumps, or the state. 1e-10 of the
    /// step earlier nothing has happened yet.
    [[nodiscard]] View smooth_end(const Path& before) {
        if constexpr (SwitchingModel<M> || SurfaceModel<M>) {
            if (path_.crossings() != before.crossings() || path_.stickings() != before.stickings()) {
                const double s = end_.s - std::max(1e-10 * (end_.s - begin_.s), 2.0 * resolution(end_.s));
                if (s > begin_.s)
                    if (const auto view = view_at(s)) return *view;
            }
        }
        return end_;
    }

    /// Crossings between two points of a step.
    void search(const View& a, const View& b, int depth) {
        double along = 0.0;
        for (std::size_t i = 0; i < n; ++i)
            along += a.f[i] * b.f[i];
        // A motion that turns back within one step may hide two crossings: it is examined in halves. Four levels, as
        // steps of two turns and more no longer resolve a solution.
        if (along < 0.0 && depth < 4) {
            if (const auto middle = view_at(0.5 * (a.s + b.s))) {
                search(a, *middle, depth + 1);
                if (status_ == FlowStatus::ok) search(*middle, b, depth + 1);
            }
            return;
        }
        const bool dips = a.slope <= 0.0 && b.slope > 0.0, rises = a.slope > 0.0 && b.slope <= 0.0;
        // The tangents at both ends bound a curve that bends one way.
        double lowest = std::min(a.g, b.g), highest = std::max(a.g, b.g);
        if (dips || rises) {
            const double ds = b.s - a.s;
            const double meet = std::clamp((b.g - a.g - b.slope * ds) / (a.slope - b.slope), 0.0, ds);
            // Twice as far, as the bound holds only for curves without an inflection of their slope.
            (dips ? lowest : highest) += 2.0 * ((dips ? a.g - lowest : a.g - highest) + a.slope * meet);
        }
        search_levels(a, b, dips, rises, lowest, highest);
    }

    void search_levels(const View& a, const View& b, bool dips, bool rises, double lowest, double highest) {
        if (std::isfinite(turn_)) {
            for (double k = std::ceil(lowest / turn_); k * turn_ <= highest && status_ == FlowStatus::ok; ++k)
                search_level(a, b, dips, rises, k * turn_);
        } else if (lowest <= 0.0 && 0.0 <= highest) {
            search_level(a, b, dips, rises, 0.0);
        }
    }

    /// The rise of g through one level.
    void search_level(const View& a, const View& b, bool dips, bool rises, double level) {
        const bool from_below = a.g < level, to_above = b.g >= level;
        if (from_below && to_above) {
            locate(a, b, level);
        } else if (!from_below && to_above && dips) {
            if (const auto low = turning_point(a, b, level); low && low->g < level) locate(*low, b, level);
        } else if (from_below && !to_above && rises) {
            if (const auto high = turning_point(a, b, level); high && high->g >= level) locate(a, *high, level);
        }
    }

    /// A point between a and b where g has passed the level before it turns back, or the turning point itself (by
    /// halving the interval between slopes of opposite sign).
    [[nodiscard]] std::optional<View> turning_point(const View& a, const View& b, double level) {
        const double side = a.slope <= 0.0 ? -1.0 : 1.0;
        View lo = a, hi = b, middle = a;
        for (int i = 0; i < 60 && hi.s - lo.s > 1e-12 * (b.s - a.s); ++i) {
            const double s = 0.5 * (lo.s + hi.s);
            if (!(lo.s < s && s < hi.s)) break;
            const auto there = view_at(s);
            if (!there) return std::nullopt;
            middle = *there;
            if (side * (middle.g - level) > rounding_) return middle;
            // The tangents from both sides do not reach the level.
            const double ends = std::max(side * (lo.g - level) + side * lo.slope * (hi.s - lo.s),
                                         side * (hi.g - level) - side * hi.slope * (hi.s - lo.s));
            if (ends < -rounding_) return middle;
            (side * middle.slope > 0.0 ? lo : hi) = middle;
        }
        // Rounding decides whether it is passed at all; but leaving a start on the plane is no touch.
        if (std::abs(middle.g - level) <= rounding_ && lo.s > begin_.s) status_ = FlowStatus::grazing;
        return middle;
    }

    /// Zero of g - level between lo (below) and hi (not below): Newton's method on s, held inside the bracket by
    /// bisection. A last step in dual arithmetic makes the time of the crossing a dual number.
    void locate(const View& lo, const View& hi, double level) {
        const double bend = std::abs(hi.slope - lo.slope) / (hi.s - lo.s);
        View below = lo, above = hi;
        std::optional<Path> path;
        View at;
        const double length = hi.s - lo.s;
        double s = lo.s + cubic_zero(lo.g - level, hi.g - level, lo.slope * length, hi.slope * length) * length;
        // Newton needs two or three; 100 is more than bisection needs to shrink any step to neighbouring doubles.
        for (int i = 0; i < 100; ++i) {
            if (!(below.s < s && s < above.s)) s = 0.5 * (below.s + above.s);
            path = path_at(s);
            if (!path) return;
            at = look(*path);
            (at.g < level ? below : above) = at;
            const double next = s - (at.g - level) / at.slope;
            // Derivatives of the crossing are as exact as its time: 1e-13 of the step, which costs Newton's method one
            // more iteration than 1e-7. Near a touch the rounding of g (a twentieth of what is allowed for it
            // elsewhere) limits the time.
            if (std::abs(next - s) <= std::max(1e-13 * (hi.s - lo.s), resolution(s)) ||
                std::abs(at.g - level) <= 0.05 * rounding_)
                break;
            // Neighbouring doubles on both sides of the plane and no zero: the state jumps over it.
            if (!(above.s - below.s > resolution(above.s))) {
                // A touch has no speed to divide by.
                if (std::abs(at.g - level) <= rounding_) status_ = FlowStatus::grazing;
                return;
            }
            s = next;
        }
        // Without rounding g would pass the level by slope^2 / (2 bend): a touch when rounding decides.
        if (!(at.slope > 0.0) || at.slope * at.slope <= 2.0 * rounding_ * bend) {
            status_ = FlowStatus::grazing;
            return;
        }
        const Point f = path->slope();
        T g(-plane_.offset - plane_.direction * level), slope(0.0);
        for (std::size_t i = 0; i < n; ++i) {
            g = g + path->state()[i] * plane_.normal[i];
            slope = slope + f[i] * plane_.normal[i];
        }
        const T ds = -g / slope;
        Crossing crossing{path->state(), ds + s};
        for (std::size_t i = 0; i < n; ++i)
            crossing.state[i] = crossing.state[i] + f[i] * ds;
        found_.push_back(crossing);
    }

    SectionPlane plane_;
    Path& path_;
    double turn_;
    View begin_, end_;  ///< of the present step
    /// Rounding of g in this step: 45 roundings of the terms of its sum, more than going to a crossing and back leaves.
    /// At a crossing itself all terms may vanish.
    double rounding_ = 0.0;
    bool started_ = false;
    const Path* before_ = nullptr;
    std::vector<Crossing> found_;  ///< in the present step, in time
    FlowStatus status_ = FlowStatus::ok;
};

/// The counterpart of flow_pass() for Kernel::crossings(). The step budget holds for each return. With N = 0 there are
/// no derivatives, and step control uses the errors of the values alone, as in ensembles of forced models.
template <Model M, std::size_t N>
FlowEnd crossing_pass(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                      std::span<const std::ptrdiff_t> free, std::size_t first, const FlowOutput& output,
                      const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t q = parameter_count_of<M>;
    auto x = array_from<Scalar<N>, n>(start.state);
    auto p = array_from<Scalar<N>, q>(start.theta);
    if constexpr (N > 0) seed<N, n, q>(x, p, free, first);
    TrajectoryOf<M, N> path(p, x, start.phase, start.clock, start.options, start.input, model);
    SectionCrossing<M, N> section(plane, path, model);
    FlowEnd end;
    double time = 0.0;
    State<double, n> state = array_from<double, n>(start.state);
    for (; end.crossings < count; ++end.crossings) {
        path.limit_steps(path.steps() + start.options.maximum_steps);
        const auto crossing = section.next(time + longest);
        if (!crossing) break;
        time = value_of(crossing->time);
        state = values_of<N, n>(crossing->state);
        std::copy(state.begin(), state.end(), output.states + end.crossings * n);
        output.times[end.crossings] = time;
        if constexpr (N > 0) {
            const std::size_t directions = n + free.size();
            store_partials<N, n>(crossing->state, first, directions,
                                 output.sensitivities + end.crossings * directions * n);
            for (std::size_t j = 0; j < N && (j < n || first + j < directions); ++j)
                output.time_sensitivities[end.crossings * directions + (j < n ? j : first + j)] =
                    crossing->time.partial[j];
        }
    }
    end.status = section.status();
    if (end.crossings < count) {
        time = path.s();
        state = values_of<N, n>(path.state());
    } else {
        end.status = FlowStatus::ok;
    }
    end.stopped_after = time;
    std::copy(state.begin(), state.end(), output.stopped_state);
    end.steps = path.steps();
    return end;
}

}  // namespace orbid::models
