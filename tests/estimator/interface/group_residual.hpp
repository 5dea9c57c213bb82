#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/errors/noise_model.hpp"
#include "estimator/interface/residual.hpp"

namespace orbid::tests {

/// A residual without records: error laws are made of its groups alone.
class GroupResidual : public estimator::Residual {
public:
    explicit GroupResidual(std::vector<estimator::Group> groups,
                           std::vector<estimator::JointCovariance> covariances = {})
        : groups_(std::move(groups)), covariances_(std::move(covariances)) {}

    std::string_view type() const override { return "groups"; }
    const std::vector<estimator::Group>& groups() const override { return groups_; }
    const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    std::vector<estimator::JointCovariance> covariances() const override { return covariances_; }
    std::vector<Eigen::VectorXd> initial_latents() const override { return {}; }
    std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet&, const Eigen::VectorXd&,
                                                const std::vector<Eigen::VectorXd>&, bool) const override {
        return {};
    }

private:
    std::vector<estimator::Group> groups_;
    std::vector<estimator::JointCovariance> covariances_;
    std::vector<estimator::BlockLayout> layout_;
};

inline estimator::Group group_of(std::string name, estimator::ErrorDistribution distribution, double scale = 1.0) {
    estimator::Group result;
    result.name = std::move(name);
    result.distribution = std::move(distribution);
    result.scale.value = scale;
    return result;
}

inline std::vector<estimator::NoiseModel> laws_of(std::vector<estimator::Group> groups,
                                                  std::vector<estimator::JointCovariance> covariances = {}) {
    GroupResidual residual(std::move(groups), std::move(covariances));
    return estimator::error_laws({&residual}, {residual.initial_set()});
}

inline estimator::NoiseModel law_of(estimator::ErrorDistribution distribution) {
    return laws_of({group_of("y", std::move(distribution))}).front();
}

/// The law of `responses` responses with one full covariance, inverse-Wishart with dof and psi if dof > 0.
inline estimator::NoiseModel joint_law(int responses, double dof = 0.0, const Eigen::MatrixXd& psi = {}) {
    std::vector<estimator::Group> groups;
    estimator::JointCovariance covariance;
    for (int g = 0; g < responses; ++g) {
        groups.push_back(group_of("y" + std::to_string(g), estimator::NormalErrors{}, 1.0 + g));
        covariance.groups.push_back(g);
    }
    covariance.dof = dof;
    covariance.psi = psi;
    return laws_of(std::move(groups), {covariance}).front();
}

}  // namespace orbid::tests
