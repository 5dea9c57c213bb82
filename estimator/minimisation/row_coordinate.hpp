#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "estimator/problem/linearisation.hpp"

namespace orbid::estimator {

/// One coordinate of the error parameters in some rows of a block.
struct RowCoordinate {
    Eigen::Index k = 0;              ///< of psi
    const PartRows* part = nullptr;  ///< null: a block with a covariance shape
    Eigen::Index first = 0;          ///< of the part's rows
    Eigen::Index rows = 0;
    bool plain = false;  ///< the scale of a law that sees sums of squares only, in a block without shape
};

/// Calls use() for the free error parameters of a block's rows, always in the same order.
/// @param parts  of the block's own records, or of its linked ones.
template <class Use>
void for_coordinates(const std::vector<NoiseModel>& laws, const std::vector<bool>& free, const BlockRows& block,
                     const std::vector<PartRows>& parts, Use use) {
    if (block.rows.size() > 0) {
        for (std::size_t k = 0; k < free.size(); ++k)
            if (free[k]) use(RowCoordinate{static_cast<Eigen::Index>(k), nullptr, 0, 0, false});
        return;
    }
    Eigen::Index row = 0;
    for (const PartRows& part : parts) {
        const NoiseModel& law = laws[part.law];
        const Eigen::Index rows = part.records.rows.rows() * law.rows_per_record();
        for (std::size_t j = 0; j < law.coordinates.size(); ++j) {
            const Eigen::Index k = law.first + static_cast<Eigen::Index>(j);
            if (free[static_cast<std::size_t>(k)]) use(RowCoordinate{k, &part, row, rows, law.compressible()});
        }
        row += rows;
    }
}

}  // namespace orbid::estimator
