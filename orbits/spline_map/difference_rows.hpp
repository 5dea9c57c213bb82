#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// A sparse matrix, row by row: each row a difference of a few coefficients.
class DifferenceRows {
public:
    struct Entry {
        std::size_t column = 0;
        double value = 0.0;
    };

    /// Adds an entry to the current row; entries of one column are summed.
    void add(std::size_t column, double value);
    /// Sorts the entries of the current row by column and begins the next row.
    void finish_row();

    [[nodiscard]] std::size_t count() const { return begin_.size() - 1; }  ///< of finished rows
    [[nodiscard]] const Entry* begin(std::size_t row) const { return entries_.data() + begin_[row]; }
    [[nodiscard]] const Entry* end(std::size_t row) const { return entries_.data() + begin_[row + 1]; }

    /// The rows times c, shape (columns).
    [[nodiscard]] Eigen::VectorXd times(const Eigen::VectorXd& c) const;
    /// The transposed rows times d, shape (rows). @return shape (columns)
    [[nodiscard]] Eigen::VectorXd transposed_times(const Eigen::VectorXd& d, Eigen::Index columns) const;

private:
    std::vector<Entry> entries_;
    std::vector<std::size_t> begin_{0};  ///< of each row in entries_, and of the current row
};

}  // namespace orbid::orbits
