#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/minimisation/minimum.hpp"
#include "estimator/uncertainty/autocorrelation.hpp"
#include "estimator/uncertainty/identifiability.hpp"
#include "estimator/uncertainty/sandwich.hpp"
#include "estimator/uncertainty/score_spectrum.hpp"

namespace orbid::estimator {

/// Uncertainty of one linear combination of the parameters.
struct Uncertainty {
    double sd = 0.0;                  ///< nan when undetermined
    double laplace_sd = 0.0;          ///< if the errors were independent
    double quantile = 0.0;            ///< half width of the 95 % interval in sds
    double degrees_of_freedom = 0.0;  ///< of a sandwich; else nan
    IntervalMethod method = IntervalMethod::none;
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
    /// Phi_psi of (M9) at the estimate; H in the coordinates u, undetermined directions left out.
    [[nodiscard]] double objective() const;
    [[nodiscard]] double log_likelihood() const;  ///< ln p(y | theta, z, psi)
    [[nodiscard]] double degrees_of_freedom() const { return degrees_of_freedom_; }
    /// A remark on the sandwich, or why there is none although it was requested; may be empty.
    [[nodiscard]] const std::string& sandwich_note() const { return sandwich_note_; }
    /// Error parameters on a logarithmic scale that reached where they no longer matter (the absolute part of errors
    /// that are relative, the dof of normal ones). They are held there, as at a limit.
    [[nodiscard]] const std::vector<Eigen::Index>& negligible_errors() const { return negligible_errors_; }
    /// Covariance of the error parameters psi; zero rows where fixed or held at a limit.
    [[nodiscard]] const Eigen::MatrixXd& error_covariance() const { return error_covariance_; }
    /// Interval of 95 % of an error parameter by likelihood, in psi; see error_interval(). Nan unless it is free.
    [[nodiscard]] std::pair<double, double> error_interval(Eigen::Index k) const;
    /// Laplace's ln of the integral over all coordinates, see Estimate::log_integral.
    [[nodiscard]] double log_integral() const;
    [[nodiscard]] const std::vector<Autocorrelation>& autocorrelations() const { return autocorrelations_; }
    /// sds of the latent states of each active block; nan where the data contain no information.
    [[nodiscard]] const std::vector<Eigen::VectorXd>& latent_sds() const { return latent_sds_; }
    [[nodiscard]] const BlockArrow& arrow() const { return point_.standard.arrow; }  ///< in the coordinates u
    [[nodiscard]] const ReducedProblem& reduced_problem() const { return point_.reduced_problem; }  ///< likewise
    /// Frees arrow(), and of reduced_problem() what has a part for every block.
    void drop_factors() { point_.drop_factors(); }

private:
    void leave_out_slack();
    void error_parameters();
    void add_error_uncertainty();
    [[nodiscard]] double constraint_term() const;
    void look_for_autocorrelation();
    [[nodiscard]] std::vector<Eigen::VectorXd> innovations(int channel) const;
    void make_sandwich();
    void make_block_sandwich();
    [[nodiscard]] bool residuals_correlated() const;
    [[nodiscard]] std::vector<ScoreRows> score_rows(double& length) const;
    [[nodiscard]] bool scores_correlated(const ScoreSpectrum& spectrum) const;
    void use_spectrum();
    [[nodiscard]] Eigen::VectorXd score_direction(const Eigen::VectorXd& direction) const;
    [[nodiscard]] Eigen::VectorXd variance_slopes(const Eigen::VectorXd& y) const;

    const Problem& problem_;
    const BlockSet& set_;
    const State& state_;
    const Minimum& minimum_;
    ErrorProblem errors_;
    ErrorPoint point_;
    Identifiability identifiability_;
    Eigen::MatrixXd covariance_;
    Eigen::MatrixXd laplace_;
    Eigen::MatrixXd slack_;  ///< part of the covariance of y that errors of slack records would add; empty: none
    Eigen::MatrixXd error_covariance_;
    double ln_error_determinant_ = 0.0;      ///< of the Hessian of Phi_psi over the free error parameters
    std::vector<Eigen::Index> free_errors_;  ///< estimated and not held at a limit
    std::vector<Eigen::Index> negligible_errors_;
    Eigen::MatrixXd moved_by_errors_;  ///< d y / d psi over free_errors_ where it counts, see add_error_uncertainty
    bool one_scale_ = false;           ///< every record has the same, estimated normal scale
    double degrees_of_freedom_ = 0.0;
    double t_quantile_ = 0.0;                        ///< where every record has one scale: half an interval over its sd
    std::vector<Autocorrelation> autocorrelations_;  ///< per channel
    std::vector<Autocorrelation> unexplained_;       ///< per channel: of innovations where errors are autoregressive
    std::unique_ptr<Sandwich> sandwich_;             ///< over blocks, where asked for
    std::unique_ptr<ScoreSpectrum> spectrum_;        ///< where records are correlated beyond what the error model says
    std::string sandwich_note_;
    std::vector<Eigen::VectorXd> latent_sds_;
};

}  // namespace orbid::estimator
