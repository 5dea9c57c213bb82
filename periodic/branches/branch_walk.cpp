#include "periodic/branches/branch_walk.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "models/system/stopped.hpp"
#include "periodic/branches/bifurcation_point.hpp"
#include "periodic/branches/branch_nodes.hpp"
#include "periodic/branches/branch_report.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

constexpr int walk_newton_steps = 6;

/// Newton's second step shall be this fraction of the first: then the third one is at rounding level.
constexpr double wanted_contraction = 0.02;
constexpr double walk_contraction = 0.3;

/// Angle between the tangents of successive points [rad]: wanted, and accepted.
constexpr double wanted_angle = 0.2;
constexpr double largest_angle = 0.5;

/// Move of a multiplier from point to point, wanted and accepted. A branch that begins at a doubling with the
/// multiplier 1 comes to the next doubling at -1: four or five points are in between.
constexpr double wanted_move = 0.4;
constexpr double walk_move = 0.8;

constexpr double largest_growth = 2.0;  // of the step
/// A point farther from its prediction than this fraction of the step may lie on another branch.
constexpr double walk_distance = 0.3;

/// Orbits of an autonomous flow smaller than this fraction of the scale end at an equilibrium.
constexpr double smallest_orbit = 1e-3;

/// How far an autonomous orbit reaches, relative to the scale.
double orbit_size(const CurvePoint& point) {
    const CurveSetting& setting = point.curve->setting();
    const MatrixXd nodes = point.curve->nodes(point.y);
    const VectorXd first = nodes.col(0);
    const VectorXd way = point.curve->time(point.y) *
                         setting.system.rhs(first, std::vector<double>{0.0}, setting.theta_at(point.parameter()));
    return std::max(relative_size(way, point.curve->scale()),
                    relative_size(nodes.colwise() - first, point.curve->scale()));
}

class Walker {
public:
    Walker(const CurvePoint& start, const ParameterRange& range, const ContinuationOptions& options, double first_step,
           std::size_t most)
        : start_(start), here_(start), range_(range), options_(options), step_(first_step), most_(most) {
        if (start.curve->autonomous()) size_ = orbit_size(start);
    }

    Walk walk() {
        result_.end = steps();
        return std::move(result_);
    }

private:
    struct Trial {
        Correction correction;
        std::optional<BranchEnd> edge;  ///< of the range, where it ends
    };

    /// Takes steps until the branch ends. @return why it does.
    BranchEnd steps() {
        std::optional<BranchEnd> edge;
        (void)edge_beyond(here_.parameter() + options_.smallest_step * here_.parameter_slope(), edge);
        const bool at_edge = here_.parameter() == range_.lower || here_.parameter() == range_.upper;
        if (edge && at_edge) return *edge;
        while (result_.points.size() < most_) {
            // A branch has two points or more.
            if (!result_.points.empty() && options_.interrupted && options_.interrupted())
                return BranchEnd::interrupted;
            if (options_.progress) options_.progress(result_.points.size(), here_.parameter());
            step_ = std::min(step_, options_.largest_step);
            if (!(step_ >= options_.smallest_step))
                return simulated_ ? BranchEnd::smallest_step : BranchEnd::not_simulated;
            try {
                if (const auto end = advance()) return *end;
            } catch (const models::Stopped&) {
                if (result_.points.empty()) throw;
                return BranchEnd::interrupted;
            }
        }
        return BranchEnd::point_limit;
    }

    [[nodiscard]] double edge_beyond(double parameter, std::optional<BranchEnd>& end) const {
        if (parameter < range_.lower) {
            end = range_.lower_end;
            return range_.lower;
        }
        if (parameter > range_.upper) {
            end = range_.upper_end;
            return range_.upper;
        }
        return parameter;
    }

    /// The point at the end of the step, or at the edge of the range within it.
    [[nodiscard]] Trial trial() const {
        Trial result;
        VectorXd guess = here_.y + step_ * here_.tangent;
        VectorXd direction = here_.tangent;
        std::optional<CurveCubic> cubic;
        if (before_) {
            cubic.emplace(*before_, here_);
            guess = cubic->value(cubic->length() + step_);
            direction = cubic->slope(cubic->length() + step_);
        }
        const double tolerance = options_.solver.tolerance;
        const auto last = guess.size() - 1;
        const double edge = edge_beyond(guess(last), result.edge);
        if (!result.edge) {
            result.correction = here_.curve->corrected(guess, direction, tolerance, walk_newton_steps);
            if (result.correction.status != OrbitStatus::converged) return result;
            const double reached = edge_beyond(result.correction.point.parameter(), result.edge);
            if (!result.edge) return result;
            result.correction = orbit_between(here_, result.correction.point, reached);
        } else {
            if (cubic) {
                const double s = cubic->where_parameter(edge, cubic->length(), cubic->length() + step_);
                guess = cubic->value(s);
            } else {
                guess = here_.y + (edge - here_.parameter()) / here_.parameter_slope() * here_.tangent;
            }
            guess(last) = edge;
            result.correction =
                here_.curve->corrected(guess, here_.curve->parameter_direction(), tolerance, walk_newton_steps);
        }
        CurvePoint& point = result.correction.point;
        if (result.correction.status != OrbitStatus::converged) return result;
        point.y(last) = edge_beyond(point.parameter(), result.edge);
        if (here_.curve->product(point.tangent, point.y - here_.y) < 0.0) point.tangent = -point.tangent;
        return result;
    }

    /// No point: a shorter step next time.
    std::optional<BranchEnd> shorten() {
        step_ *= 0.5;
        return std::nullopt;
    }

    /// One step, or a shorter one next time. @return why the walk is over, where it is.
    std::optional<BranchEnd> advance() {
        Trial next = trial();
        const Correction& correction = next.correction;
        simulated_ = correction.status != OrbitStatus::not_simulated;
        if (correction.status != OrbitStatus::converged) return shorten();
        const CurvePoint& there = correction.point;
        const OrbitCurve& curve = *here_.curve;
        const double length = curve.norm(there.y - here_.y);
        const double angle = std::acos(std::clamp(curve.product(here_.tangent, there.tangent), -1.0, 1.0));
        const double move = largest_multiplier_move(here_, there);
        const bool last_chance = step_ < 2.0 * options_.smallest_step;
        if (correction.contraction > walk_contraction || correction.distance > walk_distance * step_ ||
            angle > largest_angle || (move > walk_move && !last_chance))
            return shorten();
        double size = 0.0;
        if (curve.autonomous()) {
            size = orbit_size(there);
            // Beyond the equilibrium the orbit lies on the other side, and the flow runs the other way.
            if ((phase_cosine(there) < 0.3 && size < 0.5) || size < 0.3 * size_)
                return size_ < smallest_orbit || last_chance ? std::optional(BranchEnd::equilibrium) : shorten();
        }
        const Events events = events_between(here_, there);
        if (events.several && !last_chance && move > 0.1) return shorten();
        if (note_events(events, there)) return BranchEnd::other_branch;
        if (closes(there)) return BranchEnd::closed;
        add({there, Bifurcation::none, 0.0, arclength_ + length});
        if (const auto end = end_at(next, size)) return end;
        choose_step(correction, angle, move, size);
        arclength_ += length;
        size_ = size;
        CurvePoint fitting = with_fitting_nodes(there);
        const bool same = fitting.curve == here_.curve;
        before_ = std::move(here_);
        here_ = std::move(fitting);
        if (!same) before_.reset();
        return std::nullopt;
    }

    /// Why the walk is over at this point; none while it goes on.
    [[nodiscard]] std::optional<BranchEnd> end_at(const Trial& next, double size) const {
        if (next.edge) return *next.edge;
        const OrbitCurve& curve = *here_.curve;
        if (!curve.autonomous()) return std::nullopt;
        if (size < smallest_orbit && size < size_) return BranchEnd::equilibrium;
        if (!(curve.time(next.correction.point.y) <= options_.longest)) return BranchEnd::period_limit;
        return std::nullopt;
    }

    void choose_step(const Correction& correction, double angle, double move, double size) {
        // The prediction is wrong by the fourth power of the step with the cubic, by the second with the tangent.
        const double order = before_ ? 4.0 : 2.0;
        double factor = largest_growth;
        if (correction.contraction > 0.0)
            factor = std::min(factor, std::pow(wanted_contraction / correction.contraction, 1.0 / order));
        if (angle > 0.0) factor = std::min(factor, wanted_angle / angle);
        if (move > 0.0) factor = std::min(factor, wanted_move / move);
        // Towards an equilibrium the size goes like the arclength: it is at most halved.
        if (size > 0.0 && size < size_) factor = std::min(factor, 0.5 * size / (size_ - size));
        step_ *= std::clamp(factor, 0.3, largest_growth);
    }

    void add(WalkPoint point) { result_.points.push_back(described(std::move(point))); }

    /// Locates the bifurcations on the way; true when the branch ends in one.
    bool note_events(const Events& events, const CurvePoint& there) {
        std::vector<LocatedPoint> found;
        const auto look = [&](bool wanted, Bifurcation kind) {
            if (!wanted) return;
            LocatedPoint point = located(here_, there, kind);
            if (point.found) found.push_back(std::move(point));
        };
        look(events.fold, Bifurcation::fold);
        if (!found.empty() && meets_another(found.front().point)) {
            add({found.front().point, Bifurcation::none, found.front().parameter_error,
                 arclength_ + found.front().position});
            return true;
        }
        look(events.branch_point, Bifurcation::branch_point);
        look(events.period_doubling, Bifurcation::period_doubling);
        look(events.neimark_sacker, Bifurcation::neimark_sacker);
        std::sort(found.begin(), found.end(),
                  [](const LocatedPoint& a, const LocatedPoint& b) { return a.position < b.position; });
        for (LocatedPoint& point : found)
            add({std::move(point.point), point.bifurcation, point.parameter_error, arclength_ + point.position});
        return false;
    }

    /// Not a fold: the parameter turns as the branch meets the one it left by a doubling or a loss of symmetry.
    [[nodiscard]] bool meets_another(const CurvePoint& fold) const {
        // Both gaps go through zero there like the arclength, and are as they were before at any other fold. (The place
        // itself is only known to the root of rounding: the matrix is singular where branches cross.)
        constexpr double closed = 1e-2;
        const auto vanishes = [&](double gap, double before) {
            return std::isfinite(before) && before > same_solution && gap <= closed * before;
        };
        return vanishes(repetition_gap(fold), repetition_gap(here_)) ||
               vanishes(symmetry_gap(fold), symmetry_gap(here_));
    }

    /// Back at the start: adds it a second time.
    bool closes(const CurvePoint& there) {
        if (result_.points.size() < 3) return false;
        const double parameter = start_.parameter();
        if ((here_.parameter() < parameter) == (there.parameter() < parameter)) return false;
        const Correction back = orbit_between(here_, there, parameter);
        if (back.status != OrbitStatus::converged || !same_orbit(start_, back.point, same_solution)) return false;
        const double length = here_.curve->norm(back.point.y - here_.y);
        add({back.point, Bifurcation::none, 0.0, arclength_ + length});
        return true;
    }

    const CurvePoint start_;
    CurvePoint here_;
    std::optional<CurvePoint> before_;  ///< on the same curve as here_
    ParameterRange range_;
    const ContinuationOptions& options_;
    double step_;
    std::size_t most_;
    double arclength_ = 0.0;
    double size_ = 0.0;  ///< of an autonomous orbit, here
    bool simulated_ = true;
    Walk result_;
};

}  // namespace

WalkPoint described(WalkPoint point) {
    const CurveSetting& setting = point.point.curve->setting();
    point.orbit = reported(point.point);
    point.amplitude = amplitude_of(setting.system, setting.theta_at(point.point.parameter()),
                                   point.point.curve->mesh_at(point.point.y), setting.solver.flow);
    return point;
}

Walk walked(const CurvePoint& start, const ParameterRange& range, const ContinuationOptions& options, double first_step,
            std::size_t most) {
    return Walker(start, range, options, first_step, most).walk();
}

}  // namespace orbid::periodic
