#include "identification/stages/recorded_residual.hpp"

namespace orbid::identification {

estimator::RefreshReport RecordedResidual::update_active_set(const Eigen::VectorXd& theta,
                                                             const std::vector<Eigen::VectorXd>& latents,
                                                             const Eigen::VectorXd& scales) {
    changes_.push_back({true, 0, theta, latents, scales});
    return inner_.update_active_set(theta, latents, scales);
}

void RecordedResidual::deactivate(std::size_t block) {
    changes_.push_back({false, block, {}, {}, {}});
    inner_.deactivate(block);
}

void repeat_changes(const std::vector<ResidualChange>& changes, estimator::Residual& residual) {
    for (const ResidualChange& change : changes) {
        if (change.refreshed) {
            residual.update_active_set(change.theta, change.latents, change.scales);
        } else {
            residual.deactivate(change.block);
        }
    }
}

}  // namespace orbid::identification
