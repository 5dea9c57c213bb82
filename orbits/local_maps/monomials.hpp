#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// Number of monomials of n variables up to an order, the constant included: (n + order)! / (n! order!).
[[nodiscard]] Eigen::Index coefficient_count(Eigen::Index n, int order);

/// The monomials 1, t_a, t_a t_b (a <= b), ... of n variables, by order, within an order the last factor fastest.
///
/// Those of lower order come first: a table of order 6 serves all fits.
class Monomials {
public:
    /// @param n  >= 1, order >= 0.
    Monomials(Eigen::Index n, int order);

    [[nodiscard]] Eigen::Index variables() const { return variables_; }
    [[nodiscard]] int highest() const { return static_cast<int>(counts_.size()) - 1; }  ///< order of the table
    [[nodiscard]] Eigen::Index count(int order) const { return counts_[static_cast<std::size_t>(order)]; }

    /// The first `count` monomials at t (n numbers).
    void evaluate(const double* t, Eigen::Index count, double* values) const {
        values[0] = 1.0;
        for (Eigen::Index i = 1; i < count; ++i) {
            const Factor& product = factors_[static_cast<std::size_t>(i)];
            values[i] = values[product.parent] * t[product.variable];
        }
    }

    /// Columns of the first `count` monomials at k places, shape (k, count) column-major, from places of shape (k, n)
    /// column-major.
    void evaluate_columns(const double* places, Eigen::Index k, Eigen::Index count, double* columns) const;

    /// Derivative of monomial i with respect to variable d is exponent(i, d) times monomial lowered(i, d).
    [[nodiscard]] int exponent(Eigen::Index i, Eigen::Index d) const { return exponents_[entry(i, d)]; }
    [[nodiscard]] Eigen::Index lowered(Eigen::Index i, Eigen::Index d) const { return lowered_[entry(i, d)]; }

    struct Factor {
        Eigen::Index parent;    ///< the monomial of one order less
        Eigen::Index variable;  ///< times this one
    };
    [[nodiscard]] const Factor& factor(Eigen::Index i) const { return factors_[static_cast<std::size_t>(i)]; }

private:
    [[nodiscard]] std::size_t entry(Eigen::Index i, Eigen::Index d) const {
        return static_cast<std::size_t>(i * variables_ + d);
    }

    Eigen::Index variables_ = 0;
    std::vector<Eigen::Index> counts_;  ///< by order
    std::vector<Factor> factors_;
    std::vector<int> exponents_;
    std::vector<Eigen::Index> lowered_;
};

}  // namespace orbid::orbits
