#include "orbits/spline_map/difference_rows.hpp"

#include <algorithm>

namespace orbid::orbits {

void DifferenceRows::add(std::size_t column, double value) {
    const auto first = entries_.begin() + static_cast<std::ptrdiff_t>(begin_.back());
    const auto same = std::find_if(first, entries_.end(), [=](const Entry& entry) { return entry.column == column; });
    if (same == entries_.end())
        entries_.push_back({column, value});
    else
        same->value += value;
}

void DifferenceRows::finish_row() {
    std::sort(entries_.begin() + static_cast<std::ptrdiff_t>(begin_.back()), entries_.end(),
              [](const Entry& a, const Entry& b) { return a.column < b.column; });
    begin_.push_back(entries_.size());
}

Eigen::VectorXd DifferenceRows::times(const Eigen::VectorXd& c) const {
    Eigen::VectorXd result(static_cast<Eigen::Index>(count()));
    for (std::size_t row = 0; row < count(); ++row) {
        double sum = 0.0;
        for (const Entry* entry = begin(row); entry != end(row); ++entry)
            sum += entry->value * c[static_cast<Eigen::Index>(entry->column)];
        result[static_cast<Eigen::Index>(row)] = sum;
    }
    return result;
}

Eigen::VectorXd DifferenceRows::transposed_times(const Eigen::VectorXd& d, Eigen::Index columns) const {
    Eigen::VectorXd result = Eigen::VectorXd::Zero(columns);
    for (std::size_t row = 0; row < count(); ++row)
        for (const Entry* entry = begin(row); entry != end(row); ++entry)
            result[static_cast<Eigen::Index>(entry->column)] += entry->value * d[static_cast<Eigen::Index>(row)];
    return result;
}

}  // namespace orbid::orbits
