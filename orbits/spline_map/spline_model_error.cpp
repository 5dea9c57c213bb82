#include "orbits/spline_map/spline_model_error.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace orbid::orbits {
namespace {

// Patches along an edge of a region.
constexpr std::int64_t error_region_width = 4;

// Excess of the residuals over the reading errors that is believed, in standard errors.
constexpr double significant = 2.0;

// A variance moves by this factor in one pass at most.
constexpr double largest_factor = 8.0;

}  // namespace

PatchModelError::PatchModelError(Eigen::VectorXd smallest) : smallest_(std::move(smallest)) {}

const Eigen::VectorXd& PatchModelError::variance(const SplineBasis& basis, const double* place) const {
    const auto found = variance_.find(basis.region(place, error_region_width));
    return found == variance_.end() ? smallest_ : found->second;
}

void PatchModelError::update(const SplineBasis& basis, const Eigen::MatrixXd& places, const Eigen::MatrixXd& weighted,
                             const ReadingSmoother& smoother) {
    const Eigen::Index n = places.rows();
    struct Sums {
        Eigen::VectorXd found, expected, square;
    };
    std::map<std::int64_t, Sums> sums;
    for (std::size_t t = 0; t < smoother.steps().size(); ++t) {
        if (!smoother.steps()[t].present) continue;
        const auto at = static_cast<Eigen::Index>(t);
        Sums& sum = sums[basis.region(places.col(at).data(), error_region_width)];
        if (sum.found.size() == 0) sum.found = sum.expected = sum.square = Eigen::VectorXd::Zero(n);
        const Eigen::VectorXd precision = smoother.inverse_diagonal(t).diagonal();
        sum.found += weighted.col(at).cwiseAbs2();
        sum.expected += precision;
        sum.square += 2.0 * precision.cwiseAbs2();
    }
    for (const auto& [region, sum] : sums) {
        Eigen::VectorXd& variance = variance_.try_emplace(region, 16.0 * smallest_).first->second;
        for (Eigen::Index d = 0; d < n; ++d) {
            const double excess = sum.found[d] - significant * std::sqrt(sum.square[d]);
            const double ratio = std::clamp(excess / sum.expected[d], 1.0 / largest_factor, largest_factor);
            variance[d] = std::max(smallest_[d], variance[d] * ratio);
        }
    }
}

}  // namespace orbid::orbits
