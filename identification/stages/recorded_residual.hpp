#pragma once

#include <string_view>
#include <vector>

#include "estimator/interface/residual.hpp"

namespace orbid::identification {

/// One change that an estimate made to a residual.
struct ResidualChange {
    bool refreshed = true;  ///< false: a block was suspended
    std::size_t block = 0;  ///< suspended one
    Eigen::VectorXd theta;  ///< of update_active_set()
    std::vector<Eigen::VectorXd> latents;
    Eigen::VectorXd scales;
};

/// A residual that records its changes. Only update_active_set() and deactivate() change it. Another residual of the
/// same data that goes through the same changes, without the estimate, therefore has the same state to the bit.
class RecordedResidual final : public estimator::Residual {
public:
    explicit RecordedResidual(estimator::Residual& inner) : inner_(inner) {}

    [[nodiscard]] const std::vector<ResidualChange>& changes() const { return changes_; }

    [[nodiscard]] std::string_view type() const override { return inner_.type(); }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return inner_.groups(); }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return inner_.layout(); }
    [[nodiscard]] estimator::LatentStructure structure() const override { return inner_.structure(); }
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override { return inner_.covariances(); }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return inner_.initial_latents(); }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override {
        return inner_.evaluate(theta, latents, derivatives);
    }
    estimator::RefreshReport update_active_set(const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) override;
    void deactivate(std::size_t block) override;
    [[nodiscard]] bool is_intermediate_stage() const override { return inner_.is_intermediate_stage(); }

private:
    estimator::Residual& inner_;
    std::vector<ResidualChange> changes_;
};

/// Applies the recorded changes of another residual.
void repeat_changes(const std::vector<ResidualChange>& changes, estimator::Residual& residual);

}  // namespace orbid::identification
