#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "models/system/kernel.hpp"
#include "models/trajectories/dynamic_trajectory.hpp"

namespace orbid::models {

/// Successive crossings of a plane by a solution of a DynamicModel, with derivatives of point and time.
///
/// With h(x) = direction (normal . x - offset), a crossing is where h rises through 0. The steps are those of the
/// solution without a section; a crossing is located inside the step that passes it.
template <DynamicModel M, std::size_t N>
class DynamicSection {
public:
    using T = Dual<N>;

    DynamicSection(const SectionPlane& plane, DynamicTrajectory<M, N>& trajectory)
        : plane_(plane), trajectory_(trajectory), x_(trajectory.state()), f_(x_.size()) {
        // A start on the section, or one that rounding has put slightly below it, is no crossing.
        h_ = height(trajectory.state());
        if (std::abs(h_) <= rounding(trajectory.state())) h_ = 0.0;
    }

    /// Looks for the next crossing, until the time `latest` at most.
    /// @return no_crossing when there is none, grazing when the plane is only touched, or what ended the solution
    [[nodiscard]] FlowStatus next(double latest) {
        while (trajectory_.time() < latest) {
            const FlowStatus status = trajectory_.attempt(latest);
            if (status != FlowStatus::ok) return status;
            const double dt = trajectory_.attempted();
            const double from = h_, to = height(trajectory_.end());
            trajectory_.evaluate(trajectory_.end(), f_);
            const double slope_from = rise(trajectory_.slope()), slope_to = rise(f_);
            rounding_ = std::max(rounding(trajectory_.state()), rounding(trajectory_.end()));
            double lo = 0.0, hi = dt;
            bool crossed = from < 0.0 && to >= 0.0;
            if ((from < 0.0) == (to < 0.0) && (slope_from > 0.0) == (from < 0.0) && (slope_to > 0.0) != (from < 0.0))
                crossed = turns_beyond(from, to, slope_from, slope_to, lo, hi);
            if (crossed) locate(lo, hi);
            const double bend = std::abs(slope_to - slope_from) / dt;
            const double start = trajectory_.time();
            trajectory_.accept();
            h_ = to;
            if (touched_) return FlowStatus::grazing;
            if (crossed) return crossing_at(start, bend);
        }
        return FlowStatus::no_crossing;
    }

    /// The latest crossing.
    [[nodiscard]] const std::vector<T>& state() const { return x_; }
    [[nodiscard]] const T& time() const { return time_; }

private:
    [[nodiscard]] double height(const std::vector<T>& x) const {
        double sum = -plane_.offset;
        for (std::size_t i = 0; i < x.size(); ++i)
            sum += plane_.normal[i] * x[i].value;
        return plane_.direction * sum;
    }
    /// Rounding error of h: 1e-14 of the terms of the sum.
    [[nodiscard]] double rounding(const std::vector<T>& x) const {
        double terms = std::abs(plane_.offset);
        for (std::size_t i = 0; i < x.size(); ++i)
            terms += std::abs(plane_.normal[i] * x[i].value);
        return 1e-14 * terms;
    }
    /// dh/dt for x' = f.
    [[nodiscard]] double rise(const std::vector<T>& f) const {
        double sum = 0.0;
        for (std::size_t i = 0; i < f.size(); ++i)
            sum += plane_.normal[i] * f[i].value;
        return plane_.direction * sum;
    }

    /// Both ends of the step lie on the same side and h turns in between. Returns whether the turning point lies beyond
    /// the plane; [lo, hi] is then narrowed to the rise through 0. If rounding decides this, touched_ is set, unless
    /// the solution is leaving a start on the plane.
    bool turns_beyond(double from, double to, double slope_from, double slope_to, double& lo, double& hi) {
        // The tangents at both ends bound a curve that bends one way; others are examined only if they may come near.
        const double side = from < 0.0 ? -1.0 : 1.0;
        const double meet = (to - from - slope_to * hi) / (slope_from - slope_to);
        const double bound = side * (from + slope_from * std::clamp(meet, 0.0, hi));
        if (bound > 0.5 * std::min(side * from, side * to)) return false;
        double before = lo, behind = hi;
        for (int i = 0; i < 50 && behind - before > 1e-12 * hi; ++i) {
            const double middle = 0.5 * (before + behind);
            trajectory_.after(middle, x_);
            if (side * height(x_) < -rounding_) {
                // Below the plane h comes from here up to the end; above it, it has come up from the start.
                (side > 0.0 ? lo : hi) = middle;
                return true;
            }
            trajectory_.evaluate(x_, f_);
            ((rise(f_) > 0.0) == (slope_from > 0.0) ? before : behind) = middle;
        }
        touched_ = from != 0.0 && std::abs(height(x_)) <= rounding_;
        return false;
    }

    /// The state at the zero of h between lo (h < 0) and hi (h >= 0), to machine accuracy: Newton's method on the
    /// length of the step, held inside the bracket by bisection.
    void locate(double lo, double hi) {
        at_ = 0.5 * (lo + hi);
        // Newton needs about five. 200 is what bisection alone may need to shrink any bracket to neighbouring doubles.
        for (int i = 0; i < 200; ++i) {
            trajectory_.after(at_, x_);
            trajectory_.evaluate(x_, f_);
            const double h = height(x_);
            if (h == 0.0) return;
            (h < 0.0 ? lo : hi) = at_;
            double next = at_ - h / rise(f_);
            if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
            // The remaining step is below the rounding of the state.
            if (std::abs(next - at_) <= 4e-16 * hi) return;
            at_ = next;
        }
    }

    /// Turns the solution at a fixed time into the point of crossing. One Newton step, t_j = -(normal . x_j) / (normal
    /// . f), makes the time a dual number, and the point moves along with it.
    FlowStatus crossing_at(double start, double bend) {
        // Without rounding h would pass 0 by speed^2 / (2 bend): a touch when rounding decides.
        const double rising = rise(f_);
        if (!(rising > 0.0 && rising * rising > 2.0 * bend * rounding_)) return FlowStatus::grazing;
        const double speed = plane_.direction * rising;
        time_ = T(start + at_);
        for (std::size_t j = 0; j < N; ++j) {
            double sum = 0.0;
            for (std::size_t i = 0; i < x_.size(); ++i)
                sum += plane_.normal[i] * x_[i].partial[j];
            time_.partial[j] = -sum / speed;
        }
        for (std::size_t i = 0; i < x_.size(); ++i)
            for (std::size_t j = 0; j < N; ++j)
                x_[i].partial[j] += f_[i].value * time_.partial[j];
        return FlowStatus::ok;
    }

    SectionPlane plane_;
    DynamicTrajectory<M, N>& trajectory_;
    std::vector<T> x_;
    std::vector<T> f_;
    double h_;
    double at_ = 0.0;
    double rounding_ = 0.0;  ///< of h at both ends of the step
    bool touched_ = false;
    T time_{0.0};
};

}  // namespace orbid::models
