#include "orbits/local_maps/monomials.hpp"

#include <algorithm>
#include <map>

namespace orbid::orbits {

Eigen::Index coefficient_count(Eigen::Index n, int order) {
    Eigen::Index count = 1;
    for (int i = 1; i <= order; ++i)
        count = count * (n + i) / i;
    return count;
}

Monomials::Monomials(Eigen::Index n, int order) : variables_(n), counts_{1}, factors_{{0, 0}} {
    // Products continue with variables from the last one on, so that each monomial occurs once.
    std::size_t first = 0;
    for (int now = 1; now <= order; ++now) {
        const std::size_t end = factors_.size();
        for (std::size_t parent = first; parent < end; ++parent)
            for (Eigen::Index d = parent == 0 ? 0 : factors_[parent].variable; d < n; ++d)
                factors_.push_back({static_cast<Eigen::Index>(parent), d});
        first = end;
        counts_.push_back(static_cast<Eigen::Index>(factors_.size()));
    }

    std::map<std::vector<int>, Eigen::Index> number;
    std::vector<std::vector<int>> all;
    for (std::size_t i = 0; i < factors_.size(); ++i) {
        std::vector<int> exponents(static_cast<std::size_t>(n), 0);
        if (i > 0) {
            exponents = all[static_cast<std::size_t>(factors_[i].parent)];
            ++exponents[static_cast<std::size_t>(factors_[i].variable)];
        }
        number[exponents] = static_cast<Eigen::Index>(i);
        all.push_back(exponents);
    }
    for (std::vector<int> exponents : all)
        for (std::size_t d = 0; d < exponents.size(); ++d) {
            exponents_.push_back(exponents[d]);
            if (exponents[d] == 0) {
                lowered_.push_back(0);
                continue;
            }
            --exponents[d];
            lowered_.push_back(number.at(exponents));
            ++exponents[d];
        }
}

void Monomials::evaluate_columns(const double* places, Eigen::Index k, Eigen::Index count, double* columns) const {
    std::fill_n(columns, k, 1.0);
    for (Eigen::Index i = 1; i < count; ++i) {
        const Factor& product = factors_[static_cast<std::size_t>(i)];
        const double* parent = columns + product.parent * k;
        const double* variable = places + product.variable * k;
        double* column = columns + i * k;
        for (Eigen::Index row = 0; row < k; ++row)
            column[row] = parent[row] * variable[row];
    }
}

}  // namespace orbid::orbits
