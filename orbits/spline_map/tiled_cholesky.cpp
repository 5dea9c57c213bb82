#include "orbits/spline_map/tiled_cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <tbb/parallel_for.h>

#include "models/system/stopped.hpp"

namespace orbid::orbits {
namespace {

// Three tiles of doubles fill the first two levels of cache of common processors (96 kB).
constexpr std::size_t tile = 64;

// c -= a b, shapes (m, tile), (tile, n), rows `stride` apart. Four rows of b at once: one load and store of c for four
// products.
void subtract_product(const double* a, const double* b, double* c, std::size_t m, std::size_t n, std::size_t stride) {
    for (std::size_t i = 0; i < m; ++i) {
        const double* row_a = a + i * stride;
        double* row_c = c + i * stride;
        for (std::size_t p = 0; p < tile; p += 4) {
            const double a0 = row_a[p], a1 = row_a[p + 1], a2 = row_a[p + 2], a3 = row_a[p + 3];
            const double* b0 = b + p * stride;
            const double *b1 = b0 + stride, *b2 = b1 + stride, *b3 = b2 + stride;
            for (std::size_t j = 0; j < n; ++j)
                row_c[j] -= a0 * b0[j] + a1 * b1[j] + (a2 * b2[j] + a3 * b3[j]);
        }
    }
}

// Factor of a diagonal tile in place; false: not positive definite.
bool factor_tile(double* a, std::size_t m, std::size_t stride) {
    for (std::size_t j = 0; j < m; ++j) {
        double* row = a + j * stride;
        for (std::size_t k = 0; k < j; ++k) {
            double sum = row[k];
            for (std::size_t p = 0; p < k; ++p)
                sum -= row[p] * a[k * stride + p];
            row[k] = sum / a[k * stride + k];
        }
        double pivot = row[j];
        for (std::size_t p = 0; p < j; ++p)
            pivot -= row[p] * row[p];
        if (!(pivot > 0.0)) return false;
        row[j] = std::sqrt(pivot);
    }
    return true;
}

// a := a L^-T for a tile below the diagonal tile L: row by row, forward.
void divide_by_transpose(double* a, const double* lower, std::size_t m, std::size_t n, std::size_t stride) {
    for (std::size_t i = 0; i < m; ++i) {
        double* row = a + i * stride;
        for (std::size_t j = 0; j < n; ++j) {
            double sum = row[j];
            for (std::size_t p = 0; p < j; ++p)
                sum -= row[p] * lower[j * stride + p];
            row[j] = sum / lower[j * stride + j];
        }
    }
}

// c := L^-1 c for a row of tiles of the inverse.
void divide_by(double* c, const double* lower, std::size_t m, std::size_t n, std::size_t stride) {
    for (std::size_t i = 0; i < m; ++i) {
        double* row = c + i * stride;
        for (std::size_t p = 0; p < i; ++p) {
            const double factor = lower[i * stride + p];
            const double* other = c + p * stride;
            for (std::size_t j = 0; j < n; ++j)
                row[j] -= factor * other[j];
        }
        const double inverse = 1.0 / lower[i * stride + i];
        for (std::size_t j = 0; j < n; ++j)
            row[j] *= inverse;
    }
}

}  // namespace

TiledCholesky::TiledCholesky(std::vector<double> matrix, std::size_t size, const std::function<bool()>* interrupted)
    : factor_(std::move(matrix)), size_(size), interrupted_(interrupted) {
    const std::size_t tiles = (size + tile - 1) / tile;
    const auto rows = [&](std::size_t t) { return std::min(tile, size - t * tile); };
    const auto at = [&](std::size_t i, std::size_t j) { return factor_.data() + i * tile * size + j * tile; };
    const auto transpose = [&](std::size_t i, std::size_t j) {
        for (std::size_t r = 0; r < rows(i); ++r)
            for (std::size_t c = 0; c < rows(j); ++c)
                at(j, i)[c * size + r] = at(i, j)[r * size + c];
    };
    for (std::size_t j = 0; j < tiles; ++j) {
        // Tiles above the diagonal hold the transposes, so that products run along rows.
        tbb::parallel_for(j, tiles, [&](std::size_t i) {
            models::stop_if_asked(interrupted_);
            for (std::size_t k = 0; k < j; ++k)
                subtract_product(at(i, k), at(k, j), at(i, j), rows(i), rows(j), size);
        });
        if (!factor_tile(at(j, j), rows(j), size)) return;
        tbb::parallel_for(j + 1, tiles, [&](std::size_t i) {
            divide_by_transpose(at(i, j), at(j, j), rows(i), rows(j), size);
            transpose(i, j);
        });
        for (std::size_t r = 0; r < rows(j); ++r)
            for (std::size_t c = r + 1; c < rows(j); ++c)
                at(j, j)[r * size + c] = at(j, j)[c * size + r];
    }
    positive_definite_ = true;
}

void TiledCholesky::solve(double* x) const {
    for (std::size_t i = 0; i < size_; ++i) {
        double sum = x[i];
        const double* row = factor_.data() + i * size_;
        for (std::size_t p = 0; p < i; ++p)
            sum -= row[p] * x[p];
        x[i] = sum / row[i];
    }
    for (std::size_t i = size_; i-- > 0;) {
        double sum = x[i];
        const double* row = factor_.data() + i * size_;  // of the transpose
        for (std::size_t p = i + 1; p < size_; ++p)
            sum -= row[p] * x[p];
        x[i] = sum / row[i];
    }
}

std::vector<double> TiledCholesky::inverse_factor() const {
    std::vector<double> inverse(size_ * size_, 0.0);
    const std::size_t tiles = (size_ + tile - 1) / tile;
    const auto rows = [&](std::size_t t) { return std::min(tile, size_ - t * tile); };
    tbb::parallel_for(std::size_t{0}, tiles, [&](std::size_t j) {
        for (std::size_t i = j; i < tiles; ++i) {
            models::stop_if_asked(interrupted_);
            double* target = inverse.data() + i * tile * size_ + j * tile;
            if (i == j)
                for (std::size_t r = 0; r < rows(j); ++r)
                    target[r * size_ + r] = 1.0;
            for (std::size_t k = j; k < i; ++k)
                subtract_product(factor_.data() + i * tile * size_ + k * tile,
                                 inverse.data() + k * tile * size_ + j * tile, target, rows(i), rows(j), size_);
            divide_by(target, factor_.data() + i * tile * size_ + i * tile, rows(i), rows(j), size_);
        }
    });
    return inverse;
}

}  // namespace orbid::orbits
