#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/eigen_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

struct ProfileOptions {
    double level = 0.95;      ///< of the interval, in (0, 1)
    double tolerance = 1e-4;  ///< of the threshold at the ends of the interval, relative, > 0
    double reach = 40.0;      ///< sds from the estimate at which an end that is not found is called open, > 0
    int curve_points = 4;     ///< points to each side within the interval, for a drawing, at equal signed roots, >= 0
    int maximum_points = 60;  ///< minimisations to each side, > 0
    std::vector<std::string> names;  ///< which unknowns: parameters, "group.scale", "group.dof" ...; empty: all
    /// Called after every unknown, one call at a time; may be empty.
    std::function<void(int finished, int total)> progress{};
};

/// How an end of a profile interval was reached. bound: the likelihood has not fallen to the threshold at the bound,
/// which is the end. open: it has not within the reach (the parameter may be unbounded). failed: minimisations further
/// out fail; the end is the last that succeeded.
enum class ProfileEnd { found, bound, open, failed, interrupted };
[[nodiscard]] std::string_view name(ProfileEnd end);

struct ProfilePoint {
    double u = 0.0;            ///< coordinate
    double value = 0.0;        ///< natural
    double objective = 0.0;    ///< minimum over everything else
    double signed_root = 0.0;  ///< +-sqrt(2 (objective - minimum)), a straight line in u when all is normal
    Eigen::VectorXd theta;     ///< of all parameters there, natural
};

struct Profile {
    std::string name;
    std::string unit;
    bool known = false;  ///< false: see message
    std::string message;
    double value = 0.0;  ///< at the estimate
    double lower = 0.0;  ///< interval, natural; infinite or the bound when open
    double upper = 0.0;
    ProfileEnd lower_end = ProfileEnd::found;
    ProfileEnd upper_end = ProfileEnd::found;
    double threshold = 0.0;            ///< of 2 (objective - minimum)
    std::string method;                ///< "profile t", "profile chi2" or "profile sandwich"
    std::vector<ProfilePoint> points;  ///< ascending, the estimate among them
    std::vector<double> failed;        ///< values at which the minimisation failed, ascending
    /// objective of the minimum of the profile below that of the estimate: > 0 when a better minimum was met
    double improvement = 0.0;
    int evaluations = 0;
};

/// Profile likelihood of parameters and error parameters: everything else at its best at each value. Error parameters
/// are at their maximum likelihood with latent states integrated out ("ml" of (M9)).
///
///     interval = { u : 2 [Phi(u) - min Phi] <= threshold }
///
/// One scale unknown, everything else normal and flat: m ln(1 + t^2 / nu), exact for linear models. Here t is the
/// quantile of Student's t with nu = n - q degrees of freedom and m = nu + number of determined parameters. Otherwise
/// chi-squared with one degree of freedom. Where the interval of the estimate is from a sandwich, t is that of its
/// degrees of freedom. The quantile is multiplied by sd / laplace_sd, which stands for the objective divided by its
/// square (sandwich, slack): table and profile agree. An unknown for which the estimate has too few independent values
/// has no profile. The ends come from the signed root, nearly linear in u: secant steps kept in a bracket, each
/// minimisation started from its neighbour. Unknowns and sides are computed in parallel; the same result for any number
/// of threads.
/// @param estimate  the estimate of the same parameters, residuals and options; residuals are not changed.
/// @throws models::DataError for names of what is not estimated
/// @throws std::invalid_argument for options out of range, an estimate that failed or is of other parameters
/// Source: Bates and Watts, Nonlinear regression analysis (1988), section 6.1; the adjustment: Pauli, Racugno and
/// Ventura, Statist. Sinica 21 (2011) 149.
[[nodiscard]] std::vector<Profile> profiles(const std::vector<FreeParameter>& parameters,
                                            const std::vector<const Residual*>& residuals,
                                            const EstimateOptions& options, const Estimate& estimate,
                                            const ProfileOptions& profile = {});

}  // namespace orbid::estimator

#pragma GCC visibility pop
