#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "apps/results/result_file.hpp"
#include "estimator/estimate/estimate.hpp"

namespace orbid::apps {

/// What may be used of a result.
enum class Trust { all, values, none };
/// "all", "values", "none", as in result.json.
[[nodiscard]] std::string_view name(Trust trust);

/// The one thing that a reader must know of a result.
struct TrustVerdict {
    Trust trust = Trust::all;
    std::vector<std::string> because;  ///< reasons with their cures, those of the final level first; empty for all

    /// "trust", "trust the values, not the intervals: ...", "do not trust: ...", with the first reason, and how many
    /// more there are.
    [[nodiscard]] std::string line() const;
};

/// Draws together what an estimate and its context say against it. The worst reason decides.
///
/// none    it has not converged with less than one sd left, or was interrupted; less than three quarters of the records
///         are used; a direction that nothing decides; a parameter without even an order of magnitude; residuals twice
///         the error that was given; correlated residuals that keep more than half of the spread of a coordinate; more
///         than a tenth of the intervals do not match; a prediction three times its error; cycles of a smooth map for a
///         model that jumps; strong evidence for another model.
/// values  less than one sd is left; some records are not used; a parameter at a bound, held at its start, without an
///         interval, or known by the prior alone; an error scale at its limit; fewer than five degrees of freedom; a
///         doubtful normal approximation; correlated residuals; outliers; residuals 20 % off the error that was given;
///         intervals that do not match; a prediction twice its error; draws that cannot be trusted.
[[nodiscard]] TrustVerdict trust_verdict(const estimator::Estimate& estimate, const ResultContext& context);

/// Root mean square of residuals over the sd of the readings, by coordinate, from at least five readings.
[[nodiscard]] std::vector<std::pair<std::string, double>> unexplained_spread(const std::vector<ResidualRow>& rows);

}  // namespace orbid::apps
