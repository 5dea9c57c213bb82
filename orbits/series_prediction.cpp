#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "orbits/series_residual.hpp"

namespace orbid::orbits {
namespace {

double weighted_sum(const Eigen::VectorXd& e, const std::vector<int>& group, const Eigen::VectorXd& scales) {
    double sum = 0.0;
    for (Eigen::Index r = 0; r < e.size(); ++r) {
        const double u = e[r] / scales[group[static_cast<std::size_t>(r)]];
        sum += u * u;
    }
    return sum;
}

}  // namespace

SegmentPrediction SeriesResidual::predict_one(const Eigen::VectorXd& all, const Eigen::VectorXd& scales,
                                              std::size_t segment) const {
    constexpr int steps = 100;
    constexpr double step_tolerance = 1e-9;  // of the state's size: far below any error of a reading
    constexpr double too_damped = 1e12;
    const Block block = make_block(segment);
    Eigen::VectorXd z = guess(segment, all);
    auto now = value(block, all, z, true);
    double damping = 1e-4;
    for (int step = 0; step < steps && !free_.empty() && now.status == estimator::BlockStatus::ok; ++step) {
        // Levenberg and Marquardt: columns in their own size.
        Eigen::MatrixXd jacobian = now.e_z;
        Eigen::VectorXd e = now.e;
        for (Eigen::Index r = 0; r < e.size(); ++r) {
            const double weight = 1.0 / scales[block.group[static_cast<std::size_t>(r)]];
            jacobian.row(r) *= weight;
            e[r] *= weight;
        }
        const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
        const Eigen::VectorXd gradient = jacobian.transpose() * e;
        const double before = e.squaredNorm();
        bool accepted = false;
        bool small = false;
        while (!accepted && damping < too_damped) {
            Eigen::MatrixXd damped = normal;
            damped.diagonal() += damping * normal.diagonal();
            const Eigen::VectorXd change = -damped.completeOrthogonalDecomposition().solve(gradient);
            small = change.norm() <= step_tolerance * (1.0 + z.norm());
            const Eigen::VectorXd next = z + change;
            auto trial = value(block, all, next, true);
            accepted = trial.status == estimator::BlockStatus::ok && change.allFinite() &&
                       weighted_sum(trial.e, block.group, scales) <= before;
            if (accepted) {
                z = next;
                now = std::move(trial);
                damping = std::max(damping / 10.0, 1e-12);
            } else {
                damping *= 10.0;
            }
            if (small) break;
        }
        if (small || !accepted) break;
    }

    SegmentPrediction prediction;
    prediction.segment = segment;
    prediction.status = now.status;
    prediction.state = state(z);
    prediction.rms = Eigen::VectorXd::Constant(std::ssize(observed_), std::numeric_limits<double>::quiet_NaN());
    prediction.normalised_rms = std::numeric_limits<double>::quiet_NaN();
    if (now.status != estimator::BlockStatus::ok) return prediction;
    double total = 0.0;
    std::size_t records = 0;
    for (Eigen::Index i = 0; i < std::ssize(observed_); ++i) {
        double sum = 0.0;
        std::size_t count = 0;
        for (Eigen::Index r = 0; r < now.e.size(); ++r) {
            if (block.group[static_cast<std::size_t>(r)] != i) continue;
            sum += now.e[r] * now.e[r];
            ++count;
        }
        if (count > 0) prediction.rms[i] = std::sqrt(sum / static_cast<double>(count));
        total += sum / (scales[i] * scales[i]);
        records += count;
    }
    prediction.normalised_rms = std::sqrt(total / static_cast<double>(records));
    return prediction;
}

std::vector<SegmentPrediction> SeriesResidual::predict(const Eigen::VectorXd& theta, const Eigen::VectorXd& scales,
                                                       const std::vector<std::size_t>& segments) const {
    if (scales.size() != std::ssize(groups_) || !(scales.array() > 0.0).all()) {
        throw std::invalid_argument(
            fmt::format("prediction: {} scales, must be {} and all > 0", scales.size(), groups_.size()));
    }
    for (const std::size_t s : segments) {
        if (s >= series_.segments.size()) {
            throw std::invalid_argument(
                fmt::format("prediction: segment {} does not exist; the series has {}", s, series_.segments.size()));
        }
    }
    const Eigen::VectorXd all = binding_.values(theta);
    std::vector<SegmentPrediction> predictions(segments.size());
    oneapi::tbb::parallel_for(std::size_t{0}, segments.size(),
                              [&](std::size_t i) { predictions[i] = predict_one(all, scales, segments[i]); });
    return predictions;
}

}  // namespace orbid::orbits
