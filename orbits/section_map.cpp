#include "orbits/section_map.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

namespace orbid::orbits {

SectionMap::SectionMap(const models::System& system, double phase, const models::FlowOptions& flow)
    : system_(&system), phase_(phase), flow_(flow) {
    if (system.kind() == models::Kind::autonomous)
        throw std::invalid_argument("SectionMap: the model must be forced or a map; " + std::string(system.name()) +
                                    " is autonomous");
    if (!std::isfinite(phase)) throw std::invalid_argument("SectionMap: phase must be finite");
}

std::optional<SectionImage> SectionMap::operator()(const Eigen::VectorXd& x, const Eigen::VectorXd& theta,
                                                   std::span<const Eigen::Index> free, bool derivatives) const {
    if (!x.allFinite()) return std::nullopt;
    const bool forced = system_->kind() == models::Kind::forced;
    const models::Clock clock = forced ? models::Clock::phase : models::Clock::time;
    const double duration[] = {forced ? system_->period(theta, clock) : 1.0};
    const models::FlowResult flow =
        derivatives ? system_->flow_with_sensitivities(x, phase_, duration, theta, free, clock, flow_)
                    : system_->flow(x, phase_, duration, theta, clock, flow_);
    if (flow.status != models::FlowStatus::ok || !flow.states.allFinite() || !flow.sensitivities.allFinite())
        return std::nullopt;
    SectionImage image{flow.states.col(0), {}, {}};
    if (derivatives) {
        image.by_x = flow.sensitivities.leftCols(x.size());
        image.by_free = flow.sensitivities.rightCols(static_cast<Eigen::Index>(free.size()));
    }
    return image;
}

Eigen::MatrixXd wrapped_difference(const models::System& system, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    Eigen::MatrixXd difference = a - b;
    for (Eigen::Index i = 0; i < difference.rows(); ++i)
        if (system.coordinates()[static_cast<std::size_t>(i)].angle)
            for (Eigen::Index j = 0; j < difference.cols(); ++j)
                difference(i, j) = models::wrapped(difference(i, j));
    return difference;
}

bool in_domain(const models::System& system, const Eigen::VectorXd& theta) {
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        if (!models::contains(system.parameters()[static_cast<std::size_t>(i)].domain, theta(i))) return false;
    return true;
}

}  // namespace orbid::orbits
