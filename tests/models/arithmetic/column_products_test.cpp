#include "models/arithmetic/column_products.hpp"

#include <vector>

#include <Eigen/Core>

#include "tests/catch.hpp"

namespace orbid::models::column_products_test {

TEST_CASE("products of columns are those of Eigen, for every remainder of rows and columns", "[models]") {
    // Whole numbers: every order of summation gives the same bits.
    for (const Eigen::Index rows : {0, 1, 7, 8, 16, 29, 100})
        for (Eigen::Index count = 1; count <= 13; ++count) {
            CAPTURE(rows, count);
            Eigen::MatrixXd a(rows, count);
            for (Eigen::Index j = 0; j < count; ++j)
                for (Eigen::Index i = 0; i < rows; ++i)
                    a(i, j) = static_cast<double>((7 * i + 13 * j + i * j) % 31 - 15);
            std::vector<const double*> columns;
            for (Eigen::Index j = 0; j < count; ++j)
                columns.push_back(a.data() + j * rows);
            const Eigen::MatrixXd products = a.transpose() * a;
            Eigen::MatrixXd sums = Eigen::MatrixXd::Constant(count, count, 0.5);
            add_column_products(columns.data(), columns.size(), static_cast<std::size_t>(rows), sums.data());
            for (Eigen::Index j = 0; j < count; ++j)
                for (Eigen::Index i = 0; i < count; ++i)
                    CHECK(sums(i, j) == (i <= j ? 0.5 + products(i, j) : 0.5));
            Eigen::VectorXd along = Eigen::VectorXd::Constant(count, 0.5);
            add_products_with(columns.back(), columns.data(), columns.size(), static_cast<std::size_t>(rows),
                              along.data());
            CHECK(along == (products.col(count - 1).array() + 0.5).matrix());
        }
}

}  // namespace orbid::models::column_products_test
