#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// Singular values (columns of unit length) of directions without effect are below this, and a factor of 1000 or more
/// below all others. Exact symmetries leave 1e-16 to 1e-10 (rounding, grown along a course). The weakest directions
/// that are determined, of 29 parameters of a cell, are at 1e-10 as well, but a gap of 1e5 separates them from its
/// exact ones.
constexpr double no_effect = 1e-9;

/// Which directions of some unknowns leave all readings unchanged, to first order.
///
/// Unknowns are shared by several courses (parameters) or belong to one (its first state). The latter are eliminated
/// course by course, by an orthogonal transformation, so that what remains is the information on the shared ones.
class RankTest {
public:
    explicit RankTest(Eigen::Index shared);

    /// Readings of one course.
    /// @param by_own     shape (m, k)
    /// @param by_shared  shape (m, shared)
    /// @param own_terms, shared_terms  what the rounding of each entry is relative to, same shapes, >= 0
    /// @return how many directions of its own unknowns leave its readings unchanged
    Eigen::Index add(const Eigen::MatrixXd& by_own, const Eigen::MatrixXd& by_shared, const Eigen::MatrixXd& own_terms,
                     const Eigen::MatrixXd& shared_terms);
    /// Something else determines this shared unknown: a prior.
    void know(Eigen::Index shared);

    /// Singular values of the information on the shared unknowns, columns at unit length, descending.
    [[nodiscard]] Eigen::VectorXd singular_values() const;
    /// Directions of the shared unknowns without effect, in their own units: shape (shared, directions).
    [[nodiscard]] Eigen::MatrixXd null_directions() const;

private:
    [[nodiscard]] Eigen::MatrixXd scaled() const;
    [[nodiscard]] Eigen::VectorXd lengths() const;

    Eigen::MatrixXd information_;  ///< shape (any, shared)
    Eigen::VectorXd square_;       ///< of the lengths of columns before elimination
    Eigen::VectorXd terms_square_;
    std::vector<bool> known_;
};

/// Lengths of columns; of a column of nothing but rounding the length of its terms, or 1.
[[nodiscard]] Eigen::VectorXd column_lengths(const Eigen::VectorXd& squares, const Eigen::VectorXd& terms_squares);

/// Directions of the columns of a matrix that it maps to nothing, in the columns' own units: shape (columns, any).
[[nodiscard]] Eigen::MatrixXd null_space(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& terms);

/// The change of a course's own unknowns that undoes a change of the shared ones: least squares of smallest norm.
/// @param direction  shape (shared)
[[nodiscard]] Eigen::VectorXd compensation(const Eigen::MatrixXd& by_own, const Eigen::MatrixXd& by_shared,
                                           const Eigen::MatrixXd& own_terms, const Eigen::VectorXd& direction);

}  // namespace orbid::orbits
