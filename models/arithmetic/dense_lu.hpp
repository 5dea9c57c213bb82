#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace orbid::models {

/// L U = P A of a real matrix whose size is known when it is compiled, with partial pivoting.
template <std::size_t m>
class DenseLu {
public:
    using Matrix = std::array<std::array<double, m>, m>;

    /// @return false where the matrix is singular or holds numbers that are not finite
    [[nodiscard]] bool factor(const Matrix& a) {
        lu_ = a;
        for (std::size_t k = 0; k < m; ++k) {
            std::size_t pivot = k;
            for (std::size_t i = k + 1; i < m; ++i)
                if (std::abs(lu_[i][k]) > std::abs(lu_[pivot][k])) pivot = i;
            pivot_[k] = pivot;
            std::swap(lu_[k], lu_[pivot]);
            const double diagonal = lu_[k][k];
            if (!(std::abs(diagonal) > 0.0 && std::isfinite(diagonal))) return false;
            for (std::size_t i = k + 1; i < m; ++i) {
                const double factor = lu_[i][k] / diagonal;
                lu_[i][k] = factor;
                if (factor == 0.0) continue;
                for (std::size_t j = k + 1; j < m; ++j)
                    lu_[i][j] -= factor * lu_[k][j];
            }
        }
        return true;
    }

    /// b becomes A^-1 b. T = double, or a dual number, of which all parts are solved for.
    template <class T>
    void solve(std::array<T, m>& b) const {
        // Rows of L are exchanged along with those of A: all exchanges come first.
        for (std::size_t k = 0; k < m; ++k)
            std::swap(b[k], b[pivot_[k]]);
        for (std::size_t i = 1; i < m; ++i)
            for (std::size_t j = 0; j < i; ++j)
                b[i] = b[i] - b[j] * lu_[i][j];
        for (std::size_t i = m; i-- > 0;) {
            for (std::size_t j = i + 1; j < m; ++j)
                b[i] = b[i] - b[j] * lu_[i][j];
            b[i] = b[i] / lu_[i][i];
        }
    }

private:
    Matrix lu_;
    std::array<std::size_t, m> pivot_;
};

}  // namespace orbid::models
