#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

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

/// The same of errors that depend on few of many readings each: G, shape (records, r).
/// @param long_form  shape (readings, records): H with covariance H' H
[[nodiscard]] Eigen::MatrixXd common_root(const Eigen::SparseMatrix<double>& long_form);

inline constexpr double shared_remainder = 1e-3;

}  // namespace orbid::orbits
