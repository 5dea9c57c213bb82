#include "orbits/invariants/sample_stride.hpp"

#include <cmath>
#include <utility>

namespace orbid::orbits {

Series strided(const Series& series, std::size_t stride) {
    Series result = series;
    result.sampling = Series::Sampling::section;
    result.segments.clear();
    const auto s = static_cast<Eigen::Index>(stride);
    for (Eigen::Index first = 0; first < s; ++first)
        for (const Segment& segment : series.segments) {
            if (segment.values.cols() <= first) continue;
            const Eigen::Index count = (segment.values.cols() - first + s - 1) / s;
            Segment part{segment.label, Eigen::MatrixXd(segment.values.rows(), count), Eigen::VectorXd(count)};
            for (Eigen::Index i = 0; i < count; ++i) {
                part.values.col(i) = segment.values.col(first + i * s);
                part.times[i] = segment.times[first + i * s];
            }
            result.segments.push_back(std::move(part));
        }
    return result;
}

std::size_t sample_stride(const Series& series) {
    constexpr double far = 0.1;
    const Eigen::VectorXd scale = series.scale();
    for (std::size_t stride = 1; stride < 1000; ++stride) {
        double square = 0.0, count = 0.0;
        const auto s = static_cast<Eigen::Index>(stride);
        for (const Segment& segment : series.segments)
            for (Eigen::Index i = 0; i + s < segment.values.cols(); i += 1 + segment.values.cols() / 1000) {
                Eigen::VectorXd moved = (segment.values.col(i + s) - segment.values.col(i)).cwiseQuotient(scale);
                for (Eigen::Index d = 0; d < moved.size(); ++d)
                    if (series.coordinate(d).angle) moved[d] -= std::nearbyint(moved[d]);
                if (!moved.allFinite()) continue;
                square += moved.squaredNorm();
                count += 1.0;
            }
        if (!(count > 0.0) || square > far * far * count) return stride;
    }
    return 1000;
}

}  // namespace orbid::orbits
