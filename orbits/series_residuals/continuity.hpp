#pragma once

#include <algorithm>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// How closely the end of an interval must agree with the beginning of the next: s_{i+1} = Phi(s_i; theta) + error.
///
/// Always begins loose and is tightened in stages. Exact matching at once leads to a false minimum from nearly every
/// start, even from the true parameters.
struct Continuity {
    enum class Kind {
        exact,   ///< the model is right: an error far too small for readings to show, see exact_tightness
        normal,  ///< normal errors
        /// Errors of a diffusion that acts on every coordinate but those whose equation is x' = v, which integrate it
        /// (process_noise.hpp). Its scales, in the coordinate's unit per root second, are always estimated.
        diffusion,
        student_t  ///< Student's t with `dof`: an interval on the wrong branch of a fold does not hold back others
    };
    Kind kind = Kind::exact;
    Eigen::VectorXd sd;     ///< shape (n), in the coordinates' units, > 0; not read for exact matching
    bool estimate = false;  ///< sds are starts of estimated scales; empty `sd`: from the defects. True for a diffusion
    double dof = 4.0;       ///< student_t
    /// Continuity by equality constraints, tightened by the estimator itself; exact only.
    bool constraints = false;
    /// > 0: in place of `sd`, which is this share of each coordinate's range.
    double share = 0.0;

    /// Whether links keep a small numerical slack, which intervals allow for.
    [[nodiscard]] bool is_exact_with_slack() const { return kind == Kind::exact && !constraints; }
};

/// Exact matching: its sd over that of the readings, both relative to the ranges. Smaller ratios give no more
/// information on parameters (10 000 sections: sd of l 1.9e-7 at 2e-4, 1.72e-7 at 2e-5 and below). Ten times tighter
/// costs one more stage, a thousand times tighter costs digits.
inline constexpr double exact_tightness = 2e-5;

/// The same for sections whose readings err by more than noisy_readings of the range: this many times that error,
/// within two limits. There the posterior over nodes folds, and the best of several courses is taken, which moves
/// parameters to one side, the more the tighter they are matched. Intervals allow for the ratio (Group::slack), and
/// estimator::unbiased() takes the bias off. The ratio was chosen when records drawn anew told the bias, all of it at
/// 0.06, half at 0.01. Mean z of the pendulum's length with it, 1000 sections, noise 5e-3: -0.18 at 0.06, -0.56 at 0.01
/// (80 records), rms error 6.6e-5 and 5.0e-5. Tighter than 0.01 no error becomes smaller. docs/calibration.md has all
/// of it.
inline constexpr double noisy_tightness = 12.0;
inline constexpr double least_noisy_tightness = 1e-2;
inline constexpr double most_noisy_tightness = 0.1;
/// The same for readings at times, where errors hardly grow from one reading to the next and nothing folds. Of 95 %
/// intervals of chaotic systems at noise 5 % of a coordinate's sd cover 142 of 143 at 1e-2, 174 of 180 at 1e-3.
inline constexpr double sampled_tightness = 1e-3;
inline constexpr double noisy_readings = 5e-4;
/// Errors of readings beyond which intervals were not shown to hold, and reports say so.
inline constexpr double folding_readings = 7e-3;

/// The same where the matching sd is estimated: from here on the estimator decides.
inline constexpr double estimated_tightness = 0.1;
/// Its smallest result over the sd of the readings, both relative to the ranges, unless exact matching ends higher.
/// Below it the estimator lacks the digits that distinguish it from zero.
inline constexpr double least_tightness = 1e-4;

/// Continuity sd over the ranges at which exact matching ends, with readings of such errors.
/// @param sampled  in time, not on sections.
[[nodiscard]] inline double exact_matching(double noise, bool sampled) {
    if (!(noise > noisy_readings)) return noise * exact_tightness;
    if (sampled) return noise * sampled_tightness;
    return noise * std::clamp(noisy_tightness * noise, least_noisy_tightness, most_noisy_tightness);
}

/// Smallest estimated diffusion: of an interval, over the sd of the readings, both relative to the ranges.
inline constexpr double least_diffusion = 1e-4;

/// Below this an estimated matching sd cannot be distinguished from exact matching: the floor of its scale. Of noisy
/// sections it is lower than where exact matching ends, for errors of a model may be that small.
[[nodiscard]] inline double least_matching(double noise, bool sampled) {
    const bool folds = noise > noisy_readings && !sampled;
    const double exact = folds ? noise * least_noisy_tightness : exact_matching(noise, sampled);
    return exact > least_tightness * noise ? exact : least_tightness * noise;
}

/// Share of the matching sd that the next stage keeps. With noisy readings of sections a tenfold drop leaves single
/// intervals on the wrong branch of a fold, and where coordinates are hidden it may lead astray. Where readings at
/// times show the whole state it does neither. With readings at times the last stage follows at once where matching is
/// tighter than they are. Of 53 chaotic systems as many are solved so as with 0.4 throughout, at noise 1 % (50) and at
/// 5 % (49), in seven eighths of the time.
/// @param whole  readings at times that show the whole state.
[[nodiscard]] inline double next_share(double noise, bool whole) {
    return noise > noisy_readings && !whole ? 0.4 : 0.1;
}

}  // namespace orbid::orbits

#pragma GCC visibility pop
