#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "estimator/problem/block_set.hpp"

namespace orbid::estimator {

/// The records of all blocks under each other, each divided by its known sd, with their derivatives by theta.
class StackedRows {
public:
    explicit StackedRows(const BlockSet& set);

    [[nodiscard]] Eigen::Index records() const { return records_; }
    /// e becomes the errors, shape (records).
    void set_errors(const Evaluation& evaluation, Eigen::VectorXd& e) const;
    /// (de / dtheta)^T times one number per record, shape (parameters).
    [[nodiscard]] Eigen::VectorXd gathered(const Evaluation& at, const Eigen::VectorXd& along) const;
    /// R factor of [de / du | e], shape (parameters + 1, parameters + 1). @param slope  d theta / d u.
    [[nodiscard]] Eigen::MatrixXd triangle(const Evaluation& at, const Eigen::VectorXd& slope,
                                           const Eigen::VectorXd& e) const;

private:
    /// Rows of a block that stay in the cache while they are worked on.
    struct Piece {
        std::size_t block = 0;
        Eigen::Index first = 0;
        Eigen::Index count = 0;
        Eigen::Index place = 0;  ///< of its first record in the stack
    };

    template <class Use>
    void with_columns(const Evaluation& at, const Piece& piece, Use use) const;
    [[nodiscard]] Eigen::MatrixXd products(const Evaluation& at, const Eigen::VectorXd& e) const;
    bool by_products(const Evaluation& at, const Eigen::VectorXd& slope, const Eigen::VectorXd& e,
                     Eigen::MatrixXd& triangle) const;

    const BlockSet& set_;
    Eigen::Index records_ = 0;
    std::vector<Piece> pieces_;
};

}  // namespace orbid::estimator
