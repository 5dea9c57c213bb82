#include "periodic/branches/continuation.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "models/system/stopped.hpp"
#include "periodic/branches/bifurcation_point.hpp"
#include "periodic/branches/branch_curve.hpp"
#include "periodic/branches/branch_nodes.hpp"
#include "periodic/branches/branch_report.hpp"
#include "periodic/branches/branch_switch.hpp"
#include "periodic/branches/branch_walk.hpp"
#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::periodic {
namespace {

void require(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("follow_branches: " + message);
}

void check(const models::System& system, const VectorXd& theta, const ContinuationOptions& options) {
    const auto count = static_cast<Index>(system.parameters().size());
    require(options.parameter >= 0 && options.parameter < count,
            "parameter " + std::to_string(options.parameter) + " is not in [0, " + std::to_string(count) + ")");
    require(theta.size() == count, "theta has " + std::to_string(theta.size()) + " values, the model has " +
                                       std::to_string(count) + " parameters");
    require(std::isfinite(options.lower) && std::isfinite(options.upper) && options.lower < options.upper,
            "lower must be < upper");
    const double value = theta(options.parameter);
    require(value >= options.lower && value <= options.upper,
            "the start's " + std::string(system.parameters()[static_cast<std::size_t>(options.parameter)].name) +
                " = " + std::to_string(value) + " is not in [" + std::to_string(options.lower) + ", " +
                std::to_string(options.upper) + "]");
    require(options.direction >= -1 && options.direction <= 1, "direction must be -1, 0 or 1");
    require(options.smallest_step > 0.0, "smallest_step must be > 0");
    require(options.first_step >= options.smallest_step, "first_step must be >= smallest_step");
    require(options.largest_step >= options.first_step && std::isfinite(options.largest_step),
            "largest_step must be >= first_step");
    require(options.maximum_points >= 2, "maximum_points must be >= 2");
    require(options.maximum_period >= 1, "maximum_period must be >= 1");
    require(options.maximum_branches >= 1, "maximum_branches must be >= 1");
    require(options.longest > 0.0, "longest must be > 0");
}

/// The requested range within the model's domain. A parameter that must be > 0 is followed down to the smallest step.
ParameterRange range_of(const models::System& system, const ContinuationOptions& options) {
    ParameterRange range{options.lower, options.upper, BranchEnd::bound, BranchEnd::bound};
    const models::Domain domain = system.parameters()[static_cast<std::size_t>(options.parameter)].domain;
    if (!models::contains(domain, range.lower)) {
        range.lower =
            domain == models::Domain::positive ? options.smallest_step * (options.upper - options.lower) : 0.0;
        range.lower_end = BranchEnd::domain;
    }
    return range;
}

/// A branch that was followed, with all that is needed to go on from its points.
struct Followed {
    std::vector<WalkPoint> points;
    BranchEnd first = BranchEnd::start;
    BranchEnd last = BranchEnd::start;
    std::optional<Branch::Origin> origin;

    /// Points of a walk that begins a length after the first point.
    void append(std::vector<WalkPoint>& walk, double length) {
        for (WalkPoint& point : walk) {
            point.arclength += length;
            points.push_back(std::move(point));
        }
    }
};

/// The solved start on a curve of its own; none when its nodes cannot be simulated.
std::optional<CurvePoint> first_point(const CurveSetting& setting, const StartingSolution& start,
                                      const PeriodicOrbit& orbit) {
    StartingSolution solved = start;
    solved.points = orbit.points;
    if (setting.system.kind() == models::Kind::autonomous && !start.section) {
        solved.points = orbit.points.col(0);
        solved.time = orbit.time;
    }
    const auto& system = setting.system;
    ShootingMesh mesh = mesh_from_guess(system, setting.theta, solved, setting.solver.flow);
    if (!mesh.simulated) return std::nullopt;
    const ClosingError closing = refine_and_close(system, setting.theta, mesh, setting.solver);
    if (!closing.simulated) return std::nullopt;
    std::optional<models::Section> phase;
    if (system.kind() == models::Kind::autonomous) {
        const models::Section across = plane_across_flow(system, setting.theta, mesh.nodes.col(0));
        phase = start.section.value_or(across);
        if (phase->normal.dot(across.normal) < 0.0) phase = models::Section{-phase->normal, -phase->offset};
    }
    const MatrixXd turns = winding_numbers(closing.error, angle_coordinates(system), orbit.rotation);
    const int period = system.kind() == models::Kind::autonomous && !start.section ? 1 : orbit.period;
    const VectorXd scale = scale_along(setting, mesh);
    const auto curve = std::make_shared<const OrbitCurve>(setting, std::move(mesh), turns, scale, phase, period);
    const Correction correction =
        curve->corrected(curve->at_mesh(setting.theta(setting.parameter)), curve->parameter_direction(),
                         setting.solver.tolerance, setting.solver.maximum_iterations);
    if (correction.status != OrbitStatus::converged) return std::nullopt;
    CurvePoint point = correction.point;
    point.y(point.y.size() - 1) = setting.theta(setting.parameter);
    return with_fitting_nodes(point);
}

/// A branch ended at this bifurcation when it was followed from elsewhere.
bool ends_at(const BranchSwitch& start, const Followed& branch) {
    // Both were located, but along the other branch the parameter is stationary, and the place known to the root of
    // rounding only.
    constexpr double same_bifurcation = 1e-4;
    return branch.last == BranchEnd::other_branch &&
           (same_orbit(branch.points.back().point, start.origin, same_bifurcation) ||
            mirror_images(branch.points.back().point, start.origin, same_bifurcation));
}

/// Whether an orbit lies on a branch: solved for on the branch at the same parameter it is the same, or its mirror
/// image.
bool lies_on(const CurvePoint& orbit, const Followed& branch) {
    const double value = orbit.parameter();
    for (std::size_t k = 0; k + 1 < branch.points.size(); ++k) {
        const CurvePoint& a = branch.points[k].point;
        const CurvePoint& b = branch.points[k + 1].point;
        if (a.curve != b.curve || a.curve->period() != orbit.curve->period()) continue;
        if ((a.parameter() < value) == (b.parameter() < value) && a.parameter() != value) continue;
        const Correction there = orbit_between(a, b, value);
        if (there.status != OrbitStatus::converged) continue;
        if (same_orbit(there.point, orbit, same_solution) || mirror_images(there.point, orbit, same_solution))
            return true;
    }
    return false;
}

class Diagram {
public:
    Diagram(const CurveSetting& setting, const ContinuationOptions& options)
        : setting_(setting), options_(options), range_(range_of(setting.system, options)) {}

    void follow(const CurvePoint& start) {
        followed_.push_back(through(start));
        try {
            for (std::size_t b = 0; b < followed_.size(); ++b)
                for (std::size_t k = 0; k < followed_[b].points.size() && !stopped(); ++k)
                    switch_at(b, k);
        } catch (const models::Stopped&) {
            // A flow was left before a branch had two points; those before it are whole.
        }
    }

    [[nodiscard]] std::vector<Branch> branches() const {
        std::vector<Branch> result;
        for (const Followed& followed : followed_) {
            Branch branch{setting_.parameter, {}, followed.first, followed.last, followed.origin};
            for (const WalkPoint& at : followed.points)
                branch.points.push_back({at.point.parameter(), at.arclength, at.orbit, at.point.unstable(),
                                         at.bifurcation, at.parameter_error, at.amplitude});
            result.push_back(std::move(branch));
        }
        return result;
    }

private:
    [[nodiscard]] bool stopped() const { return options_.interrupted && options_.interrupted(); }

    /// The branch through the start of the diagram, one way or both.
    [[nodiscard]] Followed through(const CurvePoint& start) const {
        Followed result;
        const int first = options_.direction != 0 ? options_.direction : 1;
        CurvePoint ahead = start;
        if ((ahead.parameter_slope() > 0.0) != (first > 0)) ahead.tangent = -ahead.tangent;
        WalkPoint middle = described({ahead});
        Walk forwards = walked(ahead, range_, options_, options_.first_step, options_.maximum_points - 1);
        Walk backwards;
        backwards.end = BranchEnd::start;
        if (options_.direction == 0 && forwards.end != BranchEnd::closed && forwards.end != BranchEnd::interrupted &&
            forwards.points.size() + 1 < options_.maximum_points) {
            CurvePoint back = ahead;
            back.tangent = -back.tangent;
            try {
                backwards = walked(back, range_, options_, options_.first_step,
                                   options_.maximum_points - 1 - forwards.points.size());
            } catch (const models::Stopped&) {
                backwards.end = BranchEnd::interrupted;  // in its first step: the other half is whole
            }
        }
        result.first = backwards.end;
        result.last = forwards.end;
        const double length = backwards.points.empty() ? 0.0 : backwards.points.back().arclength;
        std::reverse(backwards.points.begin(), backwards.points.end());
        for (WalkPoint& point : backwards.points) {
            point.arclength = length - point.arclength;
            point.point.tangent = -point.point.tangent;
        }
        result.points = std::move(backwards.points);
        middle.arclength = length;
        result.points.push_back(std::move(middle));
        result.append(forwards.points, length);
        return result;
    }

    /// Follows what begins at a point of a branch, if anything does and is not known yet.
    void switch_at(std::size_t branch, std::size_t index) {
        if (followed_.size() >= options_.maximum_branches) return;
        const WalkPoint& at = followed_[branch].points[index];
        // Each generation of a cascade is a few times shorter than the one before: steps that are far too long for it
        // are not tried.
        constexpr double part_of_parent = 0.1;
        const double step = followed_[branch].origin
                                ? std::clamp(part_of_parent * at.arclength, options_.smallest_step, options_.first_step)
                                : options_.first_step;
        std::vector<BranchSwitch> found;
        if (at.bifurcation == Bifurcation::period_doubling && options_.switch_doublings &&
            2 * at.point.curve->period() <= options_.maximum_period) {
            if (auto one = doubled(at.point, step, options_.smallest_step)) found.push_back(std::move(*one));
        } else if (at.bifurcation == Bifurcation::branch_point && options_.switch_symmetry) {
            found = crossing(at.point, step, options_.smallest_step);
        }
        for (const BranchSwitch& start : found) {
            if (followed_.size() >= options_.maximum_branches) return;
            const bool known = std::any_of(followed_.begin(), followed_.end(), [&](const Followed& other) {
                return ends_at(start, other) || lies_on(start.first, other);
            });
            if (known) continue;
            Followed result{{}, BranchEnd::other_branch, BranchEnd::point_limit, Branch::Origin{branch, index}};
            const double length = start.first.curve->norm(start.first.y - start.origin.y);
            result.points.push_back(described({start.origin, Bifurcation::none, 0.0, 0.0}));
            result.points.push_back(described({start.first, Bifurcation::none, 0.0, length}));
            if (options_.maximum_points > 2) {
                Walk walk = walked(start.first, range_, options_, length, options_.maximum_points - 2);
                result.append(walk.points, length);
                result.last = walk.end;
            }
            followed_.push_back(std::move(result));
        }
    }

    const CurveSetting& setting_;
    const ContinuationOptions& options_;
    ParameterRange range_;
    std::vector<Followed> followed_;
};

}  // namespace

BifurcationDiagram follow_branches(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                                   const ContinuationOptions& options) {
    check(system, theta, options);
    BifurcationDiagram diagram;
    const PeriodicOrbit orbit = solve_multiple_shooting(system, theta, start, {}, options.solver);
    diagram.start_status = orbit.status;
    if (orbit.status != OrbitStatus::converged) return diagram;
    const CurveSetting setting{system,      theta,         options.parameter, options.upper - options.lower,
                               start.phase, start.section, options.solver};
    const auto first = first_point(setting, start, orbit);
    if (!first) {
        diagram.start_status = OrbitStatus::not_simulated;
        return diagram;
    }
    Diagram all(setting, options);
    all.follow(*first);
    diagram.branches = all.branches();
    return diagram;
}

std::vector<double> doubling_ratios(std::span<const double> doublings) {
    std::vector<double> ratios;
    for (std::size_t k = 1; k + 1 < doublings.size(); ++k)
        ratios.push_back((doublings[k] - doublings[k - 1]) / (doublings[k + 1] - doublings[k]));
    return ratios;
}

}  // namespace orbid::periodic
