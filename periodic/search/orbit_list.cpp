#include "periodic/search/orbit_list.hpp"

#include <cmath>
#include <limits>
#include <utility>

#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::periodic {
namespace {

/// Orbits whose points are all nearer than this (relative to the size) are one. Starts are closed to 1e-8 or better.
/// Two orbits come that near only beside a bifurcation, where that accuracy cannot separate them either.
constexpr double same_orbit = 1e-6;

/// Components that differ by less are taken as equal when the first point is chosen.
constexpr double tie = 1e-9;

/// Crossings of an autonomous orbit from its first point over one period.
std::optional<MatrixXd> crossings_of(const ModelSection& section, const VectorXd& start, double time,
                                     std::size_t at_most, const models::FlowOptions& flow) {
    // A crossing within this fraction of the period before its end is the last one.
    constexpr double end = 1e-6;
    const auto found =
        section.system.crossings(start, *section.section, at_most, section.longest, section.theta, std::nullopt, flow);
    Index count = 0;
    while (count < found.times.size() && found.times(count) <= time * (1.0 + end))
        ++count;
    if (count == 0 || (count == found.times.size() && found.status != models::FlowStatus::ok)) return std::nullopt;
    return found.states.leftCols(count);
}

/// All points cross the section in its direction.
bool crosses_forwards(const ModelSection& section, const MatrixXd& points) {
    const std::vector<double> phases(static_cast<std::size_t>(points.cols()), 0.0);
    const MatrixXd field = section.system.rhs(points, phases, section.theta);
    const VectorXd speed = field.transpose() * section.section->normal;
    return (speed.array() * section.section->direction > 0.0).all();
}

}  // namespace

MatrixXd in_canonical_order(const MatrixXd& points, const VectorXd& size) {
    Index first = 0;
    for (Index j = 1; j < points.cols(); ++j) {
        for (Index i = 0; i < points.rows(); ++i) {
            const double difference = points(i, j) - points(i, first);
            if (std::abs(difference) <= tie * size(i)) continue;
            if (difference < 0.0) first = j;
            break;
        }
    }
    return begun_later(points, first);
}

std::optional<MatrixXd> mirror_image(const ModelSection& section, const PeriodicOrbit& orbit,
                                     const models::FlowOptions& flow) {
    const auto symmetry = section.system.symmetry();
    if (!symmetry) return std::nullopt;
    const VectorXd signs = Eigen::Map<const VectorXd>(symmetry->signs.data(), orbit.points.rows());
    MatrixXd image = signs.asDiagonal() * orbit.points;
    const std::vector<Index> angles = angle_coordinates(section.system);
    if (section.system.kind() == models::Kind::autonomous) {
        const VectorXd normal = signs.asDiagonal() * section.section->normal;
        if (normal == section.section->normal) return image;
        return crossings_of(section, image.col(0), orbit.time, 4 * static_cast<std::size_t>(orbit.period) + 4, flow);
    }
    if (section.system.kind() == models::Kind::forced && symmetry->phase_shift != 0.0) {
        // The images lie at a later phase: continue to the next section.
        const double full = section.system.period(section.theta, models::Clock::phase);
        const double durations[] = {full - std::fmod(symmetry->phase_shift, full)};
        for (Index j = 0; j < image.cols(); ++j) {
            const auto later = section.system.flow(image.col(j), section.phase + symmetry->phase_shift, durations,
                                                   section.theta, models::Clock::phase, flow);
            if (later.status != models::FlowStatus::ok) return std::nullopt;
            image.col(j) = later.states.col(0);
        }
    }
    return wrapped_angles(image, angles);
}

OrbitList::OrbitList(const ModelSection& section, VectorXd size, ShootingOptions solver)
    : section_(section),
      size_(std::move(size)),
      solver_(std::move(solver)),
      angles_(angle_coordinates(section.system)) {}

std::optional<std::size_t> OrbitList::find(const MatrixXd& points, double radius) const {
    const Index p = points.cols();
    const auto near = [&](Eigen::Ref<const VectorXd> a, Eigen::Ref<const VectorXd> b) {
        for (Index i = 0; i < a.size(); ++i) {
            double gap = a(i) - b(i);
            if (section_.system.coordinates()[static_cast<std::size_t>(i)].angle) gap = models::wrapped(gap);
            if (!(std::abs(gap) <= radius * size_(i))) return false;
        }
        return true;
    };
    for (std::size_t k = 0; k < orbits_.size(); ++k) {
        const MatrixXd& known = orbits_[k].orbit.points;
        if (known.cols() != p) continue;
        for (Index shift = 0; shift < p; ++shift) {
            Index j = 0;
            while (j < p && near(points.col(j), known.col((j + shift) % p)))
                ++j;
            if (j == p) return k;
        }
    }
    return std::nullopt;
}

std::optional<std::size_t> OrbitList::insert(const MatrixXd& points, StartOrigin origin) {
    const Index prime = points.cols() / repeats_of(points, angles_, size_, same_orbit);
    const MatrixXd guess = wrapped_angles(points.leftCols(prime), angles_);
    if (const auto known = find(guess, same_orbit)) {
        ++orbits_[*known].hits;
        return std::nullopt;
    }
    ShootingOptions options = solver_;
    options.maximum_distance = std::numeric_limits<double>::infinity();
    options.scale = size_;
    PeriodicOrbit orbit;
    const auto solved = [&](const MatrixXd& from) {
        const StartingSolution start = section_.start(in_canonical_order(from, size_));
        orbit = solve_multiple_shooting(section_.system, section_.theta, start, {}, options);
        return orbit.status == OrbitStatus::converged;
    };
    if (!solved(guess)) return std::nullopt;
    if (section_.section) {
        // An orbit may touch the section between the points of its guess, or cross one of them the other way.
        const auto crossed = crossings_of(section_, orbit.points.col(0), orbit.time,
                                          4 * static_cast<std::size_t>(orbit.period) + 4, solver_.flow);
        if (!crossed) return std::nullopt;
        const bool fits = crossed->cols() == orbit.points.cols() && crosses_forwards(section_, orbit.points);
        if (!fits && !solved(*crossed)) return std::nullopt;
    }
    // Newton's method may have left the guess, and the first point may have changed.
    const MatrixXd found = orbit.points;
    if (in_canonical_order(found, size_).col(0) != found.col(0) && !solved(found)) return std::nullopt;
    if (const auto known = find(orbit.points, same_orbit)) {
        ++orbits_[*known].hits;
        return std::nullopt;
    }
    orbit.distance = 0.0;  // of a guess that says nothing
    orbits_.push_back({std::move(orbit), origin, -1, 1});
    return orbits_.size() - 1;
}

void OrbitList::look_for_mirror(std::size_t index) {
    const auto image = mirror_image(section_, orbits_[index].orbit, solver_.flow);
    if (!image) return;
    std::optional<std::size_t> partner = find(*image, same_orbit);
    if (!partner) partner = insert(*image, StartOrigin::symmetry);
    if (!partner) return;
    orbits_[index].mirror = static_cast<int>(*partner);
    orbits_[*partner].mirror = static_cast<int>(index);
}

std::optional<std::size_t> OrbitList::add(const MatrixXd& points, StartOrigin origin, bool mirror) {
    const auto index = insert(points, origin);
    if (index && mirror) look_for_mirror(*index);
    return index;
}

}  // namespace orbid::periodic
