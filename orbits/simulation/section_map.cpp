#include "orbits/simulation/section_map.hpp"
#include "orbits/records/refusal.hpp"

#include <cmath>
#include <stdexcept>

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// [s] Without a crossing for so long a start has missed the plane. Returns of the usual examples take about one unit
/// of their fast time; a flow that settles on an equilibrium would never end.
constexpr double longest_wait = 1000.0;

MatrixXd wrapped(std::span<const models::Coordinate> coordinates, MatrixXd difference) {
    for (Index i = 0; i < difference.rows(); ++i)
        if (coordinates[static_cast<std::size_t>(i)].angle)
            for (Index j = 0; j < difference.cols(); ++j)
                difference(i, j) = models::wrapped(difference(i, j));
    return difference;
}

}  // namespace

SectionMap::SectionMap(const models::System& system, const SectionPlace& place, const models::FlowOptions& flow)
    : system_(&system), place_(place), flow_(flow) {
    const bool autonomous = system.kind() == models::Kind::autonomous;
    refuse_if(autonomous && !place.plane, "SectionMap: {} is autonomous: its section is a plane, which is missing",
              system.name());
    refuse_if(!autonomous && place.plane, "SectionMap: {} is not autonomous: its sections are no crossings of a plane",
              system.name());
    if (!std::isfinite(place.phase)) throw std::invalid_argument("SectionMap: phase must be finite");
    if (place.plane) {
        const VectorXd& normal = place.plane->normal;
        refuse_if(normal.size() != system.dimension() || (normal.array() != 0.0).count() != 1 || !normal.allFinite() ||
                      !std::isfinite(place.plane->offset),
                  "SectionMap: the plane must be one on which a single coordinate has a finite value");
        for (Index i = 0; i < normal.size(); ++i)
            if (normal(i) != 0.0) normal_ = i;
        value_ = place.plane->offset / normal(normal_);
    }
    for (Index i = 0; i < system.dimension(); ++i) {
        if (i == normal_) continue;
        kept_.push_back(i);
        coordinates_.push_back(system.coordinates()[static_cast<std::size_t>(i)]);
    }
}

MatrixXd SectionMap::states(const MatrixXd& points) const {
    if (normal_ < 0) return points;
    MatrixXd result = MatrixXd::Constant(system_->dimension(), points.cols(), value_);
    result(kept_, Eigen::all) = points;
    return result;
}

MatrixXd SectionMap::points(const MatrixXd& states) const {
    if (normal_ < 0) return states;
    const Index blocks = states.rows() / system_->dimension();
    MatrixXd result(blocks * dimension(), states.cols());
    for (Index j = 0; j < blocks; ++j)
        result.middleRows(j * dimension(), dimension()) =
            states.middleRows(j * system_->dimension(), system_->dimension())(kept_, Eigen::all);
    return result;
}

MatrixXd SectionMap::directions(const MatrixXd& by_state) const {
    if (normal_ < 0) return by_state;
    return by_state(Eigen::all, kept_);
}

std::optional<SectionImage> SectionMap::crossing(const VectorXd& x, const VectorXd& theta, std::span<const Index> free,
                                                 bool derivatives) const {
    std::optional<std::span<const Index>> directions_of;
    if (derivatives) directions_of = free;
    const models::CrossingResult found =
        system_->crossings(states(x), *place_.plane, 1, longest_wait, theta, directions_of, flow_);
    if (found.status != models::FlowStatus::ok || found.states.cols() != 1 || !found.states.allFinite() ||
        !found.sensitivities.allFinite())
        return std::nullopt;
    SectionImage image{points(found.states), {}, {}};
    if (derivatives) {
        image.by_x = points(directions(found.sensitivities.leftCols(system_->dimension())));
        image.by_free = points(found.sensitivities.rightCols(static_cast<Index>(free.size())));
    }
    return image;
}

std::optional<SectionImage> SectionMap::operator()(const VectorXd& x, const VectorXd& theta,
                                                   std::span<const Index> free, bool derivatives) const {
    if (!x.allFinite()) return std::nullopt;
    if (normal_ >= 0) return crossing(x, theta, free, derivatives);
    const bool forced = system_->kind() == models::Kind::forced;
    const models::Clock clock = forced ? models::Clock::phase : models::Clock::time;
    const double duration[] = {forced ? system_->period(theta, clock) : 1.0};
    const models::FlowResult flow =
        derivatives ? system_->flow_with_sensitivities(x, phase(), duration, theta, free, clock, flow_)
                    : system_->flow(x, phase(), duration, theta, clock, flow_);
    if (flow.status != models::FlowStatus::ok || !flow.states.allFinite() || !flow.sensitivities.allFinite())
        return std::nullopt;
    SectionImage image{flow.states.col(0), {}, {}};
    if (derivatives) {
        image.by_x = flow.sensitivities.leftCols(x.size());
        image.by_free = flow.sensitivities.rightCols(static_cast<Index>(free.size()));
    }
    return image;
}

MatrixXd SectionMap::difference(const MatrixXd& a, const MatrixXd& b) const {
    return wrapped(coordinates_, a - b);
}

MatrixXd wrapped_difference(const models::System& system, const MatrixXd& a, const MatrixXd& b) {
    return wrapped(system.coordinates(), a - b);
}

bool in_domain(const models::System& system, const VectorXd& theta) {
    for (Index i = 0; i < theta.size(); ++i)
        if (!models::contains(system.parameters()[static_cast<std::size_t>(i)].domain, theta(i))) return false;
    return true;
}

}  // namespace orbid::orbits
