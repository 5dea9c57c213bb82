#include "orbits/spline_map/spline_normal_matrix.hpp"

#include <array>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "models/system/stopped.hpp"

namespace orbid::orbits {

SplineDesign::SplineDesign(const SplineMap& map, const Eigen::MatrixXd& places, const std::vector<char>& present,
                           const std::function<bool()>& interrupted)
    : map_(&map), interrupted_(&interrupted), steps_(present.size()), width_(1) {
    const Eigen::Index n = map.basis().dimension();
    for (Eigen::Index d = 0; d < n; ++d)
        width_ *= 4;
    patch_.assign(steps_ * width_, -1);
    mirrored_.assign(steps_ * width_, 0);
    value_.assign(steps_ * width_, 0.0);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, steps_, 256), [&](const tbb::blocked_range<std::size_t>& r) {
        SplineSupport support;
        for (std::size_t t = r.begin(); t < r.end(); ++t) {
            if (!present[t]) continue;
            map.basis().support(places.col(static_cast<Eigen::Index>(t)).data(), 0, support);
            if (!support.inside) continue;
            for (std::size_t f = 0; f < width_; ++f) {
                patch_[t * width_ + f] = support.patch[f];
                mirrored_[t * width_ + f] = support.mirrored[f];
                value_[t * width_ + f] = support.value[static_cast<Eigen::Index>(f)];
            }
        }
    });
    touches_.resize(static_cast<std::size_t>(map.basis().patches()));
    for (std::size_t t = 0; t < steps_; ++t)
        for (std::size_t f = t * width_; f < (t + 1) * width_; ++f)
            if (patch_[f] >= 0)
                touches_[static_cast<std::size_t>(patch_[f])].push_back({t, value_[f], mirrored_[f] != 0});
}

std::vector<double> SplineDesign::normal_matrix(const ReadingSmoother* smoother) const {
    const auto n = static_cast<std::size_t>(map_->basis().dimension());
    const auto size = static_cast<std::size_t>(map_->basis().unknowns());
    std::vector<double> matrix(size * size, 0.0);
    // Rows of one inverse of V, step after step, for all tasks.
    std::vector<std::vector<double>> rows(steps_);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, steps_, 256), [&](const tbb::blocked_range<std::size_t>& r) {
        std::vector<SmallMatrix> row;
        for (std::size_t t = r.begin(); t < r.end(); ++t) {
            if (patch_[t * width_] < 0) continue;
            models::stop_if_asked(interrupted_);
            if (smoother)
                smoother->inverse_row(t, row);
            else
                row.assign(1, SmallMatrix::Identity(map_->basis().dimension(), map_->basis().dimension()));
            for (const SmallMatrix& block : row)
                rows[t].insert(rows[t].end(), block.data(), block.data() + n * n);
        }
    });
    // Every patch owns its rows: sums are taken in the order of the series, whatever the number of threads. Blocks with
    // a later step only; the transposes complete the sum.
    tbb::parallel_for(std::size_t{0}, touches_.size(), [&](std::size_t own) {
        std::array<double, 16> factor{};
        for (const Touch& touch : touches_[own]) {
            models::stop_if_asked(interrupted_);
            for (std::size_t k = 0; k * n * n < rows[touch.step].size(); ++k) {
                const std::size_t other = touch.step + k;
                if (patch_[other * width_] < 0) continue;
                const double* block = rows[touch.step].data() + k * n * n;  // column-major
                const double weight = k == 0 ? 0.5 * touch.value : touch.value;
                for (std::size_t a = 0; a < n; ++a)
                    for (std::size_t b = 0; b < n; ++b)
                        factor[a * n + b] =
                            weight * map_->sign(touch.mirrored, static_cast<Eigen::Index>(a)) * block[b * n + a];
                for (std::size_t f = other * width_; f < (other + 1) * width_; ++f)
                    for (std::size_t b = 0; b < n; ++b) {
                        const double value = value_[f] * map_->sign(mirrored_[f] != 0, static_cast<Eigen::Index>(b));
                        double* target = matrix.data() + own * n * size + static_cast<std::size_t>(patch_[f]) * n + b;
                        for (std::size_t a = 0; a < n; ++a)
                            target[a * size] += factor[a * n + b] * value;
                    }
            }
        }
    });
    const std::vector<char>& fixed = map_->basis().fixed();
    tbb::parallel_for(std::size_t{0}, size, [&](std::size_t i) {
        models::stop_if_asked(interrupted_);
        for (std::size_t j = 0; j < i; ++j) {
            const double sum = fixed[i] || fixed[j] ? 0.0 : matrix[i * size + j] + matrix[j * size + i];
            matrix[i * size + j] = sum;
            matrix[j * size + i] = sum;
        }
        matrix[i * size + i] = fixed[i] ? 1.0 : 2.0 * matrix[i * size + i];
    });
    return matrix;
}

Eigen::VectorXd SplineDesign::gathered(const Eigen::MatrixXd& u) const {
    const Eigen::Index n = map_->basis().dimension();
    Eigen::VectorXd result = Eigen::VectorXd::Zero(map_->basis().unknowns());
    tbb::parallel_for(std::size_t{0}, touches_.size(), [&](std::size_t own) {
        for (const Touch& touch : touches_[own])
            for (Eigen::Index d = 0; d < n; ++d)
                result[static_cast<Eigen::Index>(own) * n + d] +=
                    touch.value * map_->sign(touch.mirrored, d) * u(d, static_cast<Eigen::Index>(touch.step));
    });
    const std::vector<char>& fixed = map_->basis().fixed();
    for (std::size_t i = 0; i < fixed.size(); ++i)
        if (fixed[i]) result[static_cast<Eigen::Index>(i)] = 0.0;
    return result;
}

Eigen::MatrixXd SplineDesign::spread(const Eigen::VectorXd& coefficients) const {
    const Eigen::Index n = map_->basis().dimension();
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(n, static_cast<Eigen::Index>(steps_));
    for (std::size_t t = 0; t < steps_; ++t)
        for (std::size_t f = t * width_; f < (t + 1) * width_; ++f) {
            if (patch_[f] < 0) break;
            for (Eigen::Index d = 0; d < n; ++d)
                result(d, static_cast<Eigen::Index>(t)) +=
                    value_[f] * map_->sign(mirrored_[f] != 0, d) * coefficients[patch_[f] * n + d];
        }
    return result;
}

}  // namespace orbid::orbits
