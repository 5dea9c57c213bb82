#pragma once

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// How well the end of one interval has to meet the beginning of the next: s_{i+1} = Phi(s_i; theta) + error.
///
/// Always begun loose and tightened in stages, for exact matching at once leads to a false minimum from nearly every
/// start, that at the true parameters included.
struct Continuity {
    enum class Kind {
        exact,     ///< the model is right: an error far below what readings can tell, see exact_tightness
        normal,    ///< normal errors
        student_t  ///< Student's t with `dof`: an interval on the wrong branch of a fold does not hold the others
    };
    Kind kind = Kind::exact;
    Eigen::VectorXd sd;     ///< shape (n), in the coordinates' units, > 0; not read for exact matching
    bool estimate = false;  ///< sds are starts of estimated scales; empty `sd`: from the defects
    double dof = 4.0;       ///< student_t
    /// Continuity as equality constraints, which the estimator tightens by itself; exact only.
    bool constraints = false;
};

/// Exact matching: its sd over that of the readings, both relative to the ranges. Information on parameters grows
/// until the ratio is about this small and no further (10 000 sections: sd of l 1.9e-7 at 2e-4, 1.72e-7 at 2e-5 and
/// below); ten times tighter costs a stage more, a thousand times tighter digits.
inline constexpr double exact_tightness = 2e-5;

/// The same for readings with errors beyond noisy_readings of the range. There the posterior over nodes is no normal
/// one any more (folds): estimates at tighter matching are dearer, and their intervals too short: largest error in sds
/// over ten series of 5000 sections at noise 5e-3 of the range 3.0 at 0.2, 2.3 at 0.06, 3.2 at 0.02, 5.4 at 0.006. At
/// noise 1e-3 (5000 sections) the ratios 2e-5 and 1e-2 gave one record a length 3.4 and 1.8 sds off.
inline constexpr double noisy_tightness = 1e-2;
inline constexpr double noisy_readings = 5e-4;
/// Errors of readings beyond which intervals may be too short all the same, and reports say so.
inline constexpr double folding_readings = 2e-3;

/// The same where the matching sd is to be estimated: from here on the estimator decides.
inline constexpr double estimated_tightness = 0.1;
/// The least of its results over the sd of the readings, both relative to the ranges, unless exact matching ends
/// higher: below it the estimator loses the digits that tell it from zero.
inline constexpr double least_tightness = 1e-4;

/// Continuity sd over the ranges at which exact matching ends, with readings of such errors.
[[nodiscard]] inline double exact_matching(double noise) {
    return noise * (noise > noisy_readings ? noisy_tightness : exact_tightness);
}

/// Below this an estimated matching sd is not told from exact matching: the floor of its scale.
[[nodiscard]] inline double least_matching(double noise) {
    const double exact = exact_matching(noise);
    return exact > least_tightness * noise ? exact : least_tightness * noise;
}

/// Share of the matching sd that the next stage keeps. Where readings are noisy single intervals stay on the wrong
/// branch of a fold if it falls tenfold at once.
[[nodiscard]] inline double next_share(double noise) {
    return noise > noisy_readings ? 0.4 : 0.1;
}

}  // namespace orbid::orbits

#pragma GCC visibility pop
