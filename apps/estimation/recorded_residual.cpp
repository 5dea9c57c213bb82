#include "apps/estimation/recorded_residual.hpp"

namespace orbid::apps {

estimator::RefreshReport RecordedResidual::refresh(const Eigen::VectorXd& theta,
                                                   const std::vector<Eigen::VectorXd>& latents,
                                                   const Eigen::VectorXd& scales) {
    changes_.push_back({true, 0, theta, latents, scales});
    return inner_.refresh(theta, latents, scales);
}

void RecordedResidual::suspend(std::size_t block) {
    changes_.push_back({false, block, {}, {}, {}});
    inner_.suspend(block);
}

void repeat_changes(const std::vector<ResidualChange>& changes, estimator::Residual& residual) {
    for (const ResidualChange& change : changes) {
        if (change.refreshed) {
            residual.refresh(change.theta, change.latents, change.scales);
        } else {
            residual.suspend(change.block);
        }
    }
}

}  // namespace orbid::apps
