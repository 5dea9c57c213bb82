#include "periodic/stability/floquet.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>

#include <Eigen/Jacobi>

#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXcd;
using Rotation = Eigen::JacobiRotation<Complex>;

constexpr double eps = std::numeric_limits<double>::epsilon();
constexpr int steps_per_eigenvalue = 30;  // as in LAPACK's hqr; two or three are usual

/// Eigenvalue of the trailing 2 x 2 block that is nearer to the last element.
Complex wilkinson_shift(const MatrixXcd& product) {
    const auto block = product.bottomRightCorner<2, 2>();
    const Complex half_difference = 0.5 * (block(0, 0) - block(1, 1));
    const Complex coupling = block(0, 1) * block(1, 0);
    Complex root = std::sqrt(half_difference * half_difference + coupling);
    if (std::real(std::conj(half_difference) * root) < 0.0) root = -root;
    const Complex denominator = half_difference + root;
    return denominator == 0.0 ? block(1, 1) : block(1, 1) - coupling / denominator;
}

/// The factors, each divided by a power of two so that long products neither overflow nor underflow.
struct Sequence {
    std::vector<MatrixXcd> a;
    int exponent = 0;  ///< the product was divided by 2^exponent

    [[nodiscard]] Index n() const { return a.front().rows(); }
    [[nodiscard]] std::size_t p() const { return a.size(); }

    /// Rotates rows (i, i + 1) of the first factor, restores the triangles of all others and closes the cycle on the
    /// columns of the first.
    void rotate(Index i, Rotation rotation) {
        a[0].applyOnTheLeft(i, i + 1, rotation.adjoint());
        for (std::size_t j = 1; j < p(); ++j) {
            a[j].applyOnTheRight(i, i + 1, rotation);
            Rotation next;
            next.makeGivens(a[j](i, i), a[j](i + 1, i));
            a[j].applyOnTheLeft(i, i + 1, next.adjoint());
            a[j](i + 1, i) = 0.0;
            rotation = next;
        }
        a[0].applyOnTheRight(i, i + 1, rotation);
    }

    void make_triangular_but_first() {
        for (std::size_t j = 1; j < p(); ++j)
            for (Index column = 0; column + 1 < n(); ++column)
                for (Index row = n() - 1; row > column; --row) {
                    Rotation rotation;
                    rotation.makeGivens(a[j](row - 1, column), a[j](row, column));
                    a[j].applyOnTheLeft(row - 1, row, rotation.adjoint());
                    a[j](row, column) = 0.0;
                    a[(j + 1) % p()].applyOnTheRight(row - 1, row, rotation);
                }
    }

    void make_first_hessenberg() {
        for (Index column = 0; column + 2 < n(); ++column)
            for (Index row = n() - 1; row > column + 1; --row) {
                Rotation rotation;
                rotation.makeGivens(a[0](row - 1, column), a[0](row, column));
                rotate(row - 1, rotation);
                a[0](row, column) = 0.0;
            }
    }

    /// X_0 X_{p-1} .. X_1 on the active block.
    [[nodiscard]] MatrixXcd active_product(Index low, Index high) const {
        const Index size = high - low + 1;
        MatrixXcd product = MatrixXcd::Identity(size, size);
        for (std::size_t j = 1; j < p(); ++j)
            product = a[j].block(low, low, size, size) * product;
        return a[0].block(low, low, size, size) * product;
    }

    /// A triangular factor is singular to working precision on the active block: an eigenvalue is (next to) zero.
    [[nodiscard]] bool has_zero(Index low, Index high) const {
        for (std::size_t j = 1; j < p(); ++j)
            for (Index i = low; i <= high; ++i)
                if (!(std::abs(a[j](i, i)) > eps)) return true;  // the largest element lies in [1/2, 1)
        return false;
    }

    void qr_step(Index low, Index high, Complex sigma) {
        Complex diagonal = 1.0;
        for (std::size_t j = 1; j < p(); ++j)
            diagonal *= a[j](low, low);
        Complex upper = a[0](low, low) * diagonal - sigma;
        Complex lower = a[0](low + 1, low) * diagonal;
        // Without a shift the common factor `diagonal` drops out, and must where it is zero or underflows.
        if (sigma == 0.0 || !(std::abs(lower) > eps * std::abs(sigma))) {
            upper = a[0](low, low);
            lower = a[0](low + 1, low);
        }
        Rotation rotation;
        rotation.makeGivens(upper, lower);
        rotate(low, rotation);
        for (Index i = low + 1; i < high; ++i) {
            rotation.makeGivens(a[0](i, i - 1), a[0](i + 1, i - 1));
            rotate(i, rotation);
            a[0](i + 1, i - 1) = 0.0;
        }
    }

    [[nodiscard]] bool make_first_triangular() {
        Index high = n() - 1;
        int steps = 0;
        while (high > 0) {
            Index low = high;
            while (low > 0) {
                double size = std::abs(a[0](low - 1, low - 1)) + std::abs(a[0](low, low));
                if (size == 0.0) size = a[0].norm();
                if (!(std::abs(a[0](low, low - 1)) > eps * size)) {
                    a[0](low, low - 1) = 0.0;
                    break;
                }
                --low;
            }
            if (low == high) {
                --high;
                steps = 0;
                continue;
            }
            if (++steps > steps_per_eigenvalue) return false;
            const MatrixXcd product = active_product(low, high);
            if (has_zero(low, high) && steps % 3 != 0) {
                // Unshifted steps carry the zero of a triangle to the last row of X_0, where it is split off; a shifted
                // one can put it back.
                qr_step(low, high, 0.0);
            } else if (steps % 10 == 0) {
                // A shift of the right size but without meaning, as in LAPACK, breaks a cycle of shifts that do not
                // converge (permutations have one).
                qr_step(low, high, product.bottomRows(1).norm());
            } else {
                qr_step(low, high, wilkinson_shift(product));
            }
        }
        return true;
    }

    [[nodiscard]] Complex eigenvalue(Index i) const {
        Complex product = 1.0;
        int scaled = exponent;
        for (const MatrixXcd& factor : a) {
            product *= factor(i, i);
            int shifted = 0;
            if (product != 0.0) std::frexp(std::abs(product), &shifted);
            product = {std::ldexp(product.real(), -shifted), std::ldexp(product.imag(), -shifted)};
            scaled += shifted;
        }
        return {std::ldexp(product.real(), scaled), std::ldexp(product.imag(), scaled)};
    }
};

/// The eigenvalues of a real matrix, computed in complex arithmetic, are symmetric to the real axis up to rounding.
/// Each is matched with its own mirror image or with that of another one, whichever is nearer.
void make_conjugate(std::vector<Complex>& values) {
    std::vector<Complex> open = std::move(values);
    values.clear();
    while (!open.empty()) {
        const auto widest = std::max_element(open.begin(), open.end(), [](const Complex& a, const Complex& b) {
            return std::abs(a.imag()) < std::abs(b.imag());
        });
        const Complex value = *widest;
        open.erase(widest);
        const auto partner = std::min_element(open.begin(), open.end(), [&](const Complex& a, const Complex& b) {
            return std::abs(a - std::conj(value)) < std::abs(b - std::conj(value));
        });
        if (partner != open.end() && std::abs(*partner - std::conj(value)) < 2.0 * std::abs(value.imag())) {
            const Complex mean = 0.5 * (value + std::conj(*partner));
            const Complex upper(mean.real(), std::abs(mean.imag()));
            values.push_back(upper);
            values.push_back(std::conj(upper));
            open.erase(partner);
        } else {
            values.emplace_back(value.real(), 0.0);
        }
    }
}

/// Products of neighbours, half as many.
std::vector<MatrixXd> paired(const std::vector<MatrixXd>& factors) {
    std::vector<MatrixXd> products;
    for (std::size_t j = 0; j < factors.size(); j += 2)
        products.push_back(j + 1 < factors.size() ? MatrixXd(factors[j + 1] * factors[j]) : factors[j]);
    return products;
}

}  // namespace

std::vector<Complex> floquet_multipliers(const std::vector<MatrixXd>& factors) {
    if (factors.empty()) throw std::invalid_argument("floquet_multipliers: no factors, at least one is needed");
    const Index n = factors.front().rows();
    Sequence sequence;
    Index exact_zeros = 0;
    for (const MatrixXd& factor : factors) {
        if (factor.rows() != n || factor.cols() != n || n == 0)
            throw std::invalid_argument("floquet_multipliers: factors must be square and of one size");
        if (!factor.allFinite()) throw std::invalid_argument("floquet_multipliers: a factor is not finite");
        int exponent = 0;
        std::frexp(factor.cwiseAbs().maxCoeff(), &exponent);
        sequence.exponent += exponent;
        sequence.a.emplace_back((factor * std::ldexp(1.0, -exponent)).cast<Complex>());
        exact_zeros = std::max<Index>(exact_zeros, (factor.array() == 0.0).rowwise().all().count());
    }
    sequence.make_triangular_but_first();
    sequence.make_first_hessenberg();
    if (!sequence.make_first_triangular()) {
        // Many factors among which directions grow and shrink in turn amplify rounding above what is left to remove;
        // fewer do not. Seen with the short steps of finite differences only.
        return factors.size() > 1 ? floquet_multipliers(paired(factors)) : std::vector<Complex>{};
    }

    std::vector<Complex> values;
    for (Index i = 0; i < n; ++i)
        values.push_back(sequence.eigenvalue(i));
    make_conjugate(values);
    std::stable_sort(values.begin(), values.end(),
                     [](const Complex& a, const Complex& b) { return std::abs(a) > std::abs(b); });
    for (Index i = n - exact_zeros; i < n; ++i)
        values[static_cast<std::size_t>(i)] = 0.0;
    return values;
}

Complex take_trivial(std::vector<Complex>& multipliers) {
    const auto nearest =
        std::min_element(multipliers.begin(), multipliers.end(),
                         [](const Complex& a, const Complex& b) { return std::abs(a - 1.0) < std::abs(b - 1.0); });
    const Complex trivial = *nearest;
    multipliers.erase(nearest);
    return trivial;
}

}  // namespace orbid::periodic
