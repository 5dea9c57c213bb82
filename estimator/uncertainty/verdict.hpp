#pragma once

#include <string>

#include <Eigen/Core>

#include "estimator/minimisation/minimum.hpp"
#include "estimator/uncertainty/latent_course.hpp"
#include "estimator/uncertainty/posterior.hpp"

namespace orbid::estimator {

/// The objective's own curvature at the estimate, at fixed error parameters, latent states following linearly.
struct FullHessian {
    bool known = false;  ///< false: constraints, undetermined directions, or a point beside cannot be evaluated
    bool definite = false;
    Eigen::VectorXd ratio;        ///< sd from it over the Gauss-Newton sd, shape (q); nan where not free
    double ln_determinant = 0.0;  ///< ln|hessian| - ln|Gauss-Newton|
};

/// Central differences of the exact gradient at 0.1 sds to both sides along directions that are independent by the
/// Gauss-Newton objective: 2 q evaluations with derivatives. The error is a hundredth of the effect of a fourth
/// derivative over one sd. Along single parameters a tenth of a sd may be many sds given the others, where chaotic
/// courses are no longer quadratic.
[[nodiscard]] FullHessian full_hessian(const Problem& problem, const BlockSet& set, const State& state,
                                       const Minimum& minimum, const Posterior& posterior, const LatentCourse& course,
                                       int& evaluations);

/// Whether a normal density describes the posterior of each parameter two sds to both sides.
struct Verdict {
    bool trust = true;
    std::string reason;  ///< names the parameter and what was found; empty when trusted
};

/// The objective two sds to both sides of each parameter, the others at their best (at fixed error parameters). The
/// signed roots of its rise, taken as normal, must leave between 1 and 7.5 % outside (4.55 % when all is normal). The
/// others are first moved linearly, and brought to their minimum only when that is not accurate enough: 2 evaluations
/// per parameter in the usual case. Where the first side of long data needs a minimisation, the second one begins with
/// the bend of the course that this has found, which often is accurate enough. Factors of the posterior are not needed.
[[nodiscard]] Verdict judge(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
                            const Posterior& posterior, const LatentCourse& course, const FullHessian& hessian,
                            int& evaluations);

}  // namespace orbid::estimator
