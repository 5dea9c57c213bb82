#pragma once

#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/autocorrelation.hpp"
#include "estimator/identifiability.hpp"
#include "estimator/minimum.hpp"
#include "estimator/sandwich.hpp"

namespace orbid::estimator {

/// Uncertainty of one linear combination of the parameters.
struct Uncertainty {
    double sd = 0.0;          ///< nan when undetermined
    double laplace_sd = 0.0;  ///< if the errors were independent
    double quantile = 0.0;    ///< half width of the 95 % interval in sds
    std::string method;       ///< see Estimated::interval_method
};

/// The posterior around a minimum: normal in the coordinates u, from the factors of the minimisation.
class Posterior {
public:
    Posterior(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum);

    /// Uncertainty of direction^T u, direction of shape (q).
    [[nodiscard]] Uncertainty along(const Eigen::VectorXd& direction) const;

    [[nodiscard]] const Eigen::MatrixXd& covariance() const { return covariance_; }  ///< of u, as reported
    [[nodiscard]] const Eigen::MatrixXd& laplace() const { return laplace_; }        ///< of u, independent errors
    [[nodiscard]] const Identifiability& identifiable() const { return identifiability_; }
    /// Phi_psi of (M9) at the estimate; H in the coordinates u, directions that nothing decides left out.
    [[nodiscard]] double objective() const;
    [[nodiscard]] double log_likelihood() const;  ///< ln p(y | theta, z, psi)
    [[nodiscard]] double degrees_of_freedom() const { return degrees_of_freedom_; }
    [[nodiscard]] bool has_sandwich() const { return sandwich_ != nullptr; }
    [[nodiscard]] std::size_t clusters() const { return sandwich_ ? sandwich_->clusters() : 0; }
    [[nodiscard]] double ln_scale_sd(Eigen::Index channel) const { return ln_scale_sd_[channel]; }  ///< 0 when fixed
    [[nodiscard]] const std::vector<Autocorrelation>& autocorrelations() const { return autocorrelations_; }
    /// sds of the latent states of each active block; nan where the data say nothing.
    [[nodiscard]] const std::vector<Eigen::VectorXd>& latent_sds() const { return latent_sds_; }
    /// Phi at 1.5 posterior sds to both sides of each parameter against the parabola: false when it is off by more
    /// than a factor of two, cannot be evaluated, or a bound cuts it off. Costs two evaluations per parameter.
    [[nodiscard]] bool normal_enough(int& evaluations) const;

private:
    void look_for_autocorrelation();
    void make_sandwich();

    const Problem& problem_;
    const BlockSet& set_;
    const State& state_;
    const Minimum& minimum_;
    ScalePoint point_;
    Arrow arrow_;
    Condensed condensed_;
    Identifiability identifiability_;
    Eigen::MatrixXd covariance_;
    Eigen::MatrixXd laplace_;
    Eigen::VectorXd ln_scale_sd_;
    Eigen::MatrixXd ln_scale_covariance_;  ///< zero rows where fixed
    int estimated_scales_ = 0;
    bool one_scale_ = false;  ///< every record has the same, estimated scale
    double degrees_of_freedom_ = 0.0;
    std::vector<Autocorrelation> autocorrelations_;  ///< per channel
    std::unique_ptr<Sandwich> sandwich_;
    std::vector<Eigen::VectorXd> latent_sds_;
};

}  // namespace orbid::estimator
