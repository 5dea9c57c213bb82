#pragma once

#include <vector>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// The cyclic block system of (M7) and of Newton's method on all points of an orbit at once:
///
///     d_{j+1} - X_j d_j = b_j,   j = 0 .. p-1,   d_p = d_0
///
/// Orthogonal factorisation: d_1, d_2, ... are eliminated one after the other by a QR of the two block rows that hold
/// them. A 2n x 2n system for (d_{p-1}, d_0) remains. This is a QR of the whole matrix with permuted columns, so
/// expanding and contracting directions are treated alike; the closed form (I - X_{p-1} .. X_0)^-1 loses log10
/// |multiplier| digits instead.
///
/// With a border of k further unknowns tau (the period of an autonomous orbit, a parameter) and as many conditions:
///
///     d_{j+1} - X_j d_j - G_j tau = b_j,      sum_j R_j d_j + S tau = r
///
/// The columns of tau are carried along beside those of d_0, so that the system is solved as a whole: the cyclic part
/// alone is singular for an autonomous orbit. From the rows of the border d_1, d_2, ... are eliminated with the R
/// factor of the QR. It is never nearly singular, whatever the cyclic part is, as it belongs to the problem with d_0 =
/// d_{p-1} = 0. The remaining 2n + k unknowns are solved for by a QR with pivots. (Rows inside the QR would fill the R
/// factor: p^2.)
///
/// Cost: O(p n^3) once, O(p n^2) per right-hand side.
/// Source: S. J. Wright, SIAM J. Sci. Stat. Comput. 13 (1992) 742 (structured orthogonal factorisation).
class CyclicSystem {
public:
    /// @param factors  X_0 .. X_{p-1}, shape (n, n) each, p >= 1, finite.
    /// @throws std::invalid_argument on an empty list, or factors that are not square and of one size.
    explicit CyclicSystem(const std::vector<MatrixXd>& factors);

    /// The border beside and below the cyclic matrix. The columns should be about as large as the changes of the states
    /// that matter: singular() compares with them. Rows may have any size.
    struct Border {
        MatrixXd columns;  ///< G, shape (n p, k)
        MatrixXd rows;     ///< R, shape (k, n p); or (k, n): conditions on d_0 alone
        MatrixXd corner;   ///< S, shape (k, k)
    };
    /// @param scale  typical size of each entry of d_j, shape (n), > 0; empty: 1. The matrix is factorised in powers of
    /// two of it: units of coordinates decide neither pivots nor singular().
    /// @throws std::invalid_argument also on a border or a scale whose shape does not fit the factors.
    CyclicSystem(const std::vector<MatrixXd>& factors, const Border& border, const VectorXd& scale = {});

    /// The matrix is singular to working precision: its R factor has a diagonal element below 1e-14 of the largest.
    /// (Rounding of a QR is a few n p eps; a solution above that still has correct digits.)
    [[nodiscard]] bool singular() const { return singular_; }

    /// @param b  shape (n p + k, m), rows [n j, n (j + 1)) = b_j, the last k rows = r (k = 0 without a border).
    /// @return d, and tau below it, in the same shape and order. Not finite when singular.
    [[nodiscard]] MatrixXd solve(const MatrixXd& b) const;

    /// The vector that a matrix which is singular, or nearly so, takes next to zero, of norm one in units of the scale:
    /// three steps of inverse iteration. The same every time.
    [[nodiscard]] VectorXd null_vector() const;

private:
    struct Elimination {
        models::HouseholderFactor qr;  ///< of the two blocks that multiply d_j, shape (2n, n)
        MatrixXd to_first;             ///< what the upper rows hold of d_0 and tau, shape (n, n + k)
        MatrixXd to_next;              ///< and of d_{j+1}
        MatrixXd off_rows;             ///< times the upper rows, taken off the border's, shape (k, n)
    };

    void factorise(const std::vector<MatrixXd>& factors, const Border& border);
    /// @param last  R of the last factor.
    [[nodiscard]] MatrixXd solve_scaled(const MatrixXd& b, const MatrixXd& last) const;

    Index n_ = 0;
    Index p_ = 0;
    Index k_ = 0;                            ///< width of the border
    VectorXd unit_;                          ///< of every d_j, shape (n): powers of two; empty: 1
    VectorXd row_unit_;                      ///< of every row of the border, shape (k)
    std::vector<Elimination> eliminations_;  ///< of d_1 .. d_{p-2}
    models::PivotedFactor last_;
    bool singular_ = false;
};

}  // namespace orbid::periodic
