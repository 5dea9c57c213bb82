#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"

namespace orbid::estimator {

/// An unknown whose prior does not integrate to one.
struct ImproperPrior {
    std::string name;        ///< parameter, "group.scale", "group.dof" ..., "covariance of a, b"
    std::string coordinate;  ///< in which it is flat: "linear", "log", ...
};

/// The components of the evidence of one model.
struct EvidenceTerms {
    double log_integral = 0.0;  ///< Estimate::log_integral with priors cut off at bounds renormalised
    std::vector<ImproperPrior> improper;
    std::size_t records = 0;
    /// Why Laplace's integral is not a valid evidence: not converged, undetermined directions, a parameter at a bound
    /// (naming it); empty when it is valid.
    std::string obstacle;
    /// By how much Laplace's integral is too small if the minimisation ended up to unfinished_sds before its minimum.
    double excess = 0.0;
};

/// A minimisation that ended this close to its minimum, in posterior sds, may still be compared with others: the
/// quadratic model of Laplace's integral gives what is missing.
inline constexpr double unfinished_sds = 3.0;

struct Evidence {
    bool known = false;
    double value = 0.0;        ///< nan when not known
    double uncertainty = 0.0;  ///< of a Bayes factor by minimisations that were not finished
    std::string message;       ///< why not, naming the parameter
};

/// Collects what log_evidence() and log_bayes_factor() need; residuals must be those of the estimate.
[[nodiscard]] EvidenceTerms evidence_terms(const std::vector<FreeParameter>& parameters,
                                           const std::vector<const Residual*>& residuals,
                                           const EstimateOptions& options, const Estimate& estimate);

/// ln p(y | model), theta, latent states and error parameters integrated out (Laplace). Requires proper priors: a flat
/// one leaves an arbitrary factor. Latent states count as flat in their own units.
[[nodiscard]] Evidence log_evidence(const EvidenceTerms& model);

/// ln p(y | a) - ln p(y | b). Flat priors that both models share (same name, same coordinate) cancel. One that only one
/// of them has is refused by name, as are models of different numbers of records.
[[nodiscard]] Evidence log_bayes_factor(const EvidenceTerms& a, const EvidenceTerms& b);

}  // namespace orbid::estimator
