#pragma once

#include <cstddef>
#include <functional>
#include <vector>

namespace orbid::orbits {

/// Cholesky factor of a dense symmetric positive definite matrix of thousands of rows, and its inverse.
///
/// Tiles of 64 x 64, those of one step in parallel. Each tile is summed in a fixed order, so that the result does not
/// depend on the number of threads. The interface has no Eigen types: the file is compiled for the machine it runs on,
/// and Eigen's alignment depends on such flags.
///
/// Cost: size^3 / 3 multiplications for the factor, as many for its inverse; two matrices of memory with the inverse.
class TiledCholesky {
public:
    /// @param matrix  row-major, shape (size, size); only the lower triangle is read.
    /// @param interrupted  asked for every row of tiles, also for the inverse; it outlives the factor; nullptr: never.
    /// @throws models::Stopped if it says so
    TiledCholesky(std::vector<double> matrix, std::size_t size, const std::function<bool()>* interrupted = nullptr);

    [[nodiscard]] bool positive_definite() const { return positive_definite_; }
    [[nodiscard]] std::size_t size() const { return size_; }
    /// Solution of matrix x = right_side, in place; shape (size).
    void solve(double* right_side) const;
    /// Inverse of the lower factor, row-major, shape (size, size), zero above the diagonal.
    [[nodiscard]] std::vector<double> inverse_factor() const;

private:
    std::vector<double> factor_;  ///< L below and on the diagonal, its transpose above
    std::size_t size_ = 0;
    const std::function<bool()>* interrupted_;
    bool positive_definite_ = false;
};

}  // namespace orbid::orbits
