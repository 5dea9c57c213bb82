#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include "orbits/cycles/cycle.hpp"

namespace orbid::orbits {

/// Writes the errors that cycles share (Cycle::common) with as few columns as they need.
///
/// Cycles of one map share the errors of its coefficients, thousands of them. Their joint covariance is that of some
/// hundred columns and a remainder, of which no record keeps more than `shared_remainder` of its shared variance. What
/// is left out stays in the cycles' own covariances, so that it counts as independent: nothing is taken for better
/// known than it is.
///
/// Incomplete Cholesky factor with pivots of the covariance in units of the records' own sds; the next pivot is the
/// record with the largest remainder. (Harbrecht, Peters, Schneider, Applied Numerical Mathematics 62:428-440, 2012.)
///
/// @param cycles  all with as many columns, or none. Entries without remain so.
/// Cost: records x columns (old + new) x new columns; memory records x old columns.
void shorten_common_errors(std::vector<Cycle>& cycles);

/// The same from the shared covariance of all records: G, shape (records, r).
/// @param sd          roots of its diagonal; 0 or not finite: the record shares nothing
/// @param largest     columns that are enough in any case
/// @param covariance  of one record with all, shape (records)
[[nodiscard]] Eigen::MatrixXd common_root(const Eigen::VectorXd& sd, Eigen::Index largest,
                                          const std::function<Eigen::VectorXd(Eigen::Index)>& covariance);

inline constexpr double shared_remainder = 1e-3;

}  // namespace orbid::orbits
