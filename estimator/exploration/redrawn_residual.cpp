#include "estimator/exploration/redrawn_residual.hpp"

#include <cassert>
#include <utility>

namespace orbid::estimator {

RedrawnResidual::RedrawnResidual(const Residual& inner, ActiveSet begin, std::vector<Eigen::VectorXd> shifts)
    : inner_(inner), shifts_(std::move(shifts)), initial_(std::move(begin)) {
    assert(shifts_.size() == initial_.layout.size());
    initial_.is_intermediate_stage = false;
    for (std::size_t b = 0; b < shifts_.size(); ++b)
        if (shifts_[b].size() > 0 && initial_.layout[b].observed.size() > 0)
            initial_.layout.edit()[b].observed += shifts_[b];
}

std::vector<BlockValue> RedrawnResidual::evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                                  const std::vector<Eigen::VectorXd>& latents, bool derivatives) const {
    std::vector<BlockValue> values = inner_.evaluate(active, theta, latents, derivatives);
    for (std::size_t b = 0; b < values.size(); ++b)
        if (values[b].status == BlockStatus::ok && values[b].e.size() > 0) values[b].e += shifts_[b];
    return values;
}

}  // namespace orbid::estimator
