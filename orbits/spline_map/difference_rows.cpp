#include "orbits/spline_map/difference_rows.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "orbits/spline_map/spline_basis.hpp"

namespace orbid::orbits {

namespace {

constexpr std::size_t highest_order = 3;

// (-1)^(m - j) binomial(m, j): coefficients of the m-th difference.
constexpr std::array<std::array<double, highest_order + 1>, highest_order + 1> signed_binomials{
    {{1, 0, 0, 0}, {-1, 1, 0, 0}, {1, -2, 1, 0}, {-1, 3, -3, 1}}};

constexpr std::array<double, highest_order + 1> factorial{1.0, 1.0, 2.0, 6.0};

// All ways to share the orders that are left among the axes from d on.
void distribute(std::size_t d, std::size_t left, std::vector<std::size_t>& orders,
                std::vector<std::vector<std::size_t>>& all) {
    if (d + 1 == orders.size()) {
        orders[d] = left;
        all.push_back(orders);
        return;
    }
    for (std::size_t m = 0; m <= left; ++m) {
        orders[d] = m;
        distribute(d + 1, left - m, orders, all);
    }
}

}  // namespace

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

void SplineBasis::find_stencil(std::int64_t raw, const std::vector<std::size_t>& orders, Eigen::Index coordinate,
                               std::vector<std::pair<std::size_t, double>>& stencil) const {
    stencil.clear();
    const double sign = section_->symmetric() ? section_->signs()[coordinate] : 1.0;
    std::size_t members = 1;
    for (const std::size_t m : orders)
        members *= m + 1;
    for (std::size_t member = 0; member < members; ++member) {
        std::int64_t other = 0, rest_of_raw = raw, factor = 1;
        std::size_t rest = member;
        double weight = 1.0;
        bool exists = true;
        for (std::size_t d = axes_.size(); d-- > 0;) {
            const std::size_t j = rest % (orders[d] + 1);
            rest /= orders[d] + 1;
            std::int64_t place = rest_of_raw % axes_[d].functions + static_cast<std::int64_t>(j);
            rest_of_raw /= axes_[d].functions;
            if (place >= axes_[d].functions) {
                if (!axes_[d].circle) exists = false;
                place -= axes_[d].functions;
            }
            other += place * factor;
            factor *= axes_[d].functions;
            weight *= signed_binomials[orders[d]][j];
        }
        const auto at = static_cast<std::size_t>(other);
        if (!exists || number_[at] < 0) return stencil.clear();
        const Eigen::Index unknown = number_[at] * dimension() + coordinate;
        stencil.emplace_back(static_cast<std::size_t>(unknown), flipped_[at] ? weight * sign : weight);
    }
}

std::int64_t SplineBasis::difference_region(std::int64_t raw, const std::vector<std::size_t>& orders,
                                            std::int64_t width) const {
    std::int64_t box = 0, factor = 1;
    for (std::size_t d = axes_.size(); d-- > 0;) {
        const std::int64_t functions = axes_[d].functions;
        const std::int64_t centre = (raw % functions + static_cast<std::int64_t>(orders[d] / 2)) % functions;
        raw /= functions;
        box += centre / width * factor;
        factor *= functions / width + 1;
    }
    return box;
}

DifferenceRows SplineBasis::third_differences(Eigen::Index coordinate, std::int64_t width,
                                              std::vector<std::int64_t>& region) const {
    region.clear();
    std::vector<std::size_t> orders(axes_.size(), 0);
    std::vector<std::vector<std::size_t>> all;
    distribute(0, highest_order, orders, all);
    DifferenceRows rows;
    std::vector<std::pair<std::size_t, double>> stencil;
    for (const std::vector<std::size_t>& along : all) {
        double multiplicity = 6.0;  // 3! / (orders!): the norm of third derivatives does not depend on the axes' choice
        for (const std::size_t m : along)
            multiplicity /= factorial[m];
        for (std::int64_t raw = 0; raw < std::ssize(number_); ++raw) {
            if (number_[static_cast<std::size_t>(raw)] < 0) continue;
            find_stencil(raw, along, coordinate, stencil);
            if (stencil.empty()) continue;
            for (const auto& [unknown, weight] : stencil)
                if (!fixed_[unknown]) rows.add(unknown, std::sqrt(multiplicity) * weight);
            rows.finish_row();
            region.push_back(difference_region(raw, along, width));
        }
    }
    return rows;
}

}  // namespace orbid::orbits
