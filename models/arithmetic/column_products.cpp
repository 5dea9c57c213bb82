#include "models/arithmetic/column_products.hpp"

#include <algorithm>

#include "models/arithmetic/vector_register.hpp"

namespace orbid::models {

namespace {

using Register = VectorRegister<register_width>;

/// So many columns by so many: their sums, and a register of each, stay in registers.
constexpr std::size_t tile = register_width == 8 ? 4 : 3;

double total(const Register& lanes) {
    double sum = 0.0;
    for (std::size_t l = 0; l < register_width; ++l)
        sum += lanes[l];
    return sum;
}

/// Products of the columns left[0 .. m) with right[0 .. n).
template <std::size_t m, std::size_t n>
void add_tile(const double* const* left, const double* const* right, std::size_t rows, double* sums,
              std::size_t stride) {
    Register sum[m][n] = {};
    std::size_t r = 0;
    for (; r + register_width <= rows; r += register_width) {
        Register a[m];
        for (std::size_t i = 0; i < m; ++i)
            a[i] = load_register<Register>(left[i] + r);
        for (std::size_t j = 0; j < n; ++j) {
            const Register b = load_register<Register>(right[j] + r);
            for (std::size_t i = 0; i < m; ++i)
                sum[i][j] += a[i] * b;
        }
    }
    for (std::size_t j = 0; j < n; ++j)
        for (std::size_t i = 0; i < m; ++i) {
            double whole = total(sum[i][j]);
            for (std::size_t rest = r; rest < rows; ++rest)
                whole += left[i][rest] * right[j][rest];
            sums[j * stride + i] += whole;
        }
}

/// Calls use<n>() for n = count <= tile.
template <std::size_t n = tile, class Use>
void with_count(std::size_t count, const Use& use) {
    if (count == n)
        use.template operator()<n>();
    else if constexpr (n > 1)
        with_count<n - 1>(count, use);
}

}  // namespace

void add_column_products(const double* const* columns, std::size_t count, std::size_t rows, double* sums) {
    for (std::size_t j = 0; j < count; j += tile)
        with_count(std::min(tile, count - j), [&]<std::size_t n>() {
            for (std::size_t i = 0; i < j; i += tile)
                add_tile<tile, n>(columns + i, columns + j, rows, sums + j * count + i, count);
            // On the diagonal column by column, so that nothing below it is touched.
            for (std::size_t k = 0; k < n; ++k)
                with_count(k + 1, [&]<std::size_t m>() {
                    add_tile<m, 1>(columns + j, columns + j + k, rows, sums + (j + k) * count + j, count);
                });
        });
}

void add_products_with(const double* column, const double* const* columns, std::size_t count, std::size_t rows,
                       double* sums) {
    for (std::size_t i = 0; i < count; i += tile)
        with_count(std::min(tile, count - i),
                   [&]<std::size_t m>() { add_tile<m, 1>(columns + i, &column, rows, sums + i, count); });
}

}  // namespace orbid::models
