#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "orbits/cycles/cycle.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct CycleExpansionOptions {
    /// The list holds every prime cycle of the set up to this period, mirror partners included; in [1, 64]. Only the
    /// caller knows this: an expansion cannot see what lies between its cycles. Longer cycles are not used.
    int complete_to = 0;
    /// The map of the section is continuous without winding: a disc or a cylinder into itself, as for every
    /// stroboscopic section of a damped system. By Lefschetz's theorem the sum of the indices sign det(1 - J^n) over
    /// the points with x = f^n(x) is then the same for all n. A list that violates this is refused. False for sections
    /// that tear (Lorenz) and maps of a degree (doubling of a circle).
    bool continuous = true;
};

/// Averages over the set by the cycles up to one period. Rates are per section, or per second when the cycles have
/// times. nan: the truncated expansion has no positive zero.
struct CycleExpansionTerm {
    int period = 0;             ///< of the longest cycles used
    std::size_t cycles = 0;     ///< prime cycles up to there
    double coefficient = 0.0;   ///< of z^period in the spectral determinant
    double conservation = 0.0;  ///< F(1) of the determinant, times left out; 0 for an attractor, which loses no points
    double determinant_zero = 0.0;  ///< leading zero in z of the spectral determinant, times left out
    double zeta_zero = 0.0;         ///< the same for the dynamical zeta function
    double escape_rate = 0.0;       ///< ln z of the zero (flows: -s); 0 for an attractor
    Eigen::VectorXd exponents;      ///< Lyapunov exponents of the section map's directions, shape (n), largest first
    double metric_entropy = 0.0;    ///< sum of the positive exponents minus the escape rate (Pesin)
    double topological_entropy = 0.0;
    double mean_time = 1.0;  ///< mean return time [s]; 1 without times
    double dimension = 0.0;  ///< Kaplan-Yorke, of the section (a flow's is larger by 1)
};

/// Invariants of a chaotic set from its unstable periodic orbits.
struct CycleExpansion {
    std::vector<CycleExpansionTerm> by_period;  ///< truncated at 1, 2, ..., complete_to: the last is the answer
    bool timed = false;                         ///< rates are per second
    /// Sum of indices over the points of f^n = id, n = 1, ..., complete_to.
    std::vector<int> index_sums;
    /// sds of the answer due to the covariances of ln|multiplier|; 0 for cycles without. They do not include
    /// truncation: see by_period and the conservation.
    double escape_rate_sd = 0.0;
    Eigen::VectorXd exponent_sds;

    [[nodiscard]] const CycleExpansionTerm& answer() const { return by_period.back(); }
};

/// Cycle expansion of the spectral determinant and of the zeta functions (Cvitanovic; Artuso, Aurell, Cvitanovic 1990;
/// mathematics.md, section 6):
///
///     F(z, s, beta) = exp(- sum_p sum_r z^(p r) e^(-s T_p r) |Lambda_p|^(beta r) / (r |det(1 - J_p^r)|))
///
/// expanded in z up to complete_to by the recursion n Q_n = - sum_k t_k Q_{n-k}; |det| becomes |Lambda_p|^r (product of
/// the expanding multipliers) for the dynamical and 1 for the topological zeta function. With z = 1 the zero in s is
/// minus the escape rate. Its slope ds/dbeta_i is the mean exponent of direction i (|Lambda_i|^(beta_i r) instead of
/// |Lambda|). Without times T_p = p, and z = e^(-s).
///
/// Expansions of hyperbolic sets converge faster than exponentially. They converge slowly where stable and unstable
/// directions touch (Henon, most measured systems): Henon's cycles to period 8 give the exponent 0.4934 instead of
/// 0.41922.
///
/// @param cycles  period, multipliers (n of each, of the section map: without a flow's trivial 1), all or no times;
///                mirror and ln_multiplier_covariance where known, other members are not read.
/// @throws std::invalid_argument when complete_to is not in [1, 64]; DataError when no cycle is that short, periods are
///         not positive,
///         numbers of multipliers differ, a multiplier is not finite or has modulus 1, a cycle is stable, times are
///         given for some only or not positive, a mirror partner is not in the list, or the index sums of a
///         continuous map differ (the message names the period that lacks a cycle or has one too many).
[[nodiscard]] CycleExpansion expand_cycles(std::span<const Cycle> cycles, const CycleExpansionOptions& options);

}  // namespace orbid::orbits

#pragma GCC visibility pop
