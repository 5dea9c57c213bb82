#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "orbits/series_residuals/series_residual.hpp"

namespace orbid::orbits {

SeriesResidual::Standard SeriesResidual::standard(const Block& block, Eigen::Index record, double e, double scale,
                                                  double relative) const {
    const auto group = static_cast<std::size_t>(block.group[static_cast<std::size_t>(record)]);
    const double s = scale * block.deviation[record];
    const double predicted = block.observed[record] - e;
    const auto& distribution = groups_[group].distribution;
    if (std::holds_alternative<estimator::LogNormalErrors>(distribution)) {
        // A prediction that is not > 0 has no logarithm: no step there is accepted.
        if (!(predicted > 0.0)) return {std::numeric_limits<double>::infinity(), 0.0};
        return {std::log(block.observed[record] / predicted) / s, 1.0 / (s * predicted)};
    }
    if (std::holds_alternative<estimator::RelativeErrors>(distribution)) {
        const double sd = std::hypot(s, relative * predicted);
        return {e / sd, 1.0 / sd};  // the sd moves little with the prediction: a step's length, not its aim
    }
    return {e / s, 1.0 / s};
}

double SeriesResidual::error_sd(std::size_t block, Eigen::Index record, double e, double scale, double relative) const {
    return 1.0 / standard(blocks_[block], record, e, scale, relative).slope;
}

SeriesResidual::Standard SeriesResidual::standard(const Block& block, Eigen::Index record, const Eigen::VectorXd& e,
                                                  const Eigen::VectorXd& scales,
                                                  const Eigen::VectorXd& relative) const {
    const auto g = block.group[static_cast<std::size_t>(record)];
    return standard(block, record, e[record], scales[g], relative[g]);
}

/// Levenberg and Marquardt, columns in their own size.
estimator::BlockValue SeriesResidual::fit_state(const Block& block, const Eigen::VectorXd& all,
                                                const Eigen::VectorXd& scales, const Eigen::VectorXd& relative,
                                                Eigen::VectorXd& x0) const {
    constexpr int steps = 100;
    constexpr double step_tolerance = 1e-9;  // of the state's size: far below any error of a reading
    constexpr double too_damped = 1e12;
    std::vector<Eigen::Index> fitted = free_;
    fitted.insert(fitted.end(), given_.begin(), given_.end());
    const auto sum_of_squares = [&](const Eigen::VectorXd& e) {
        double sum = 0.0;
        for (Eigen::Index r = 0; r < e.size(); ++r) {
            const double u = standard(block, r, e, scales, relative).value;
            sum += u * u;
        }
        return sum;
    };
    auto now = value(block, all, x0, true);
    double damping = 1e-4;
    for (int step = 0; step < steps && !fitted.empty() && now.status == estimator::BlockStatus::ok; ++step) {
        Eigen::MatrixXd jacobian = now.e_z(Eigen::all, fitted);
        Eigen::VectorXd u = now.e;
        for (Eigen::Index r = 0; r < u.size(); ++r) {
            const Standard at = standard(block, r, now.e, scales, relative);
            jacobian.row(r) *= at.slope;
            u[r] = at.value;
        }
        const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
        const Eigen::VectorXd gradient = jacobian.transpose() * u;
        const double before = u.squaredNorm();
        if (!std::isfinite(before)) break;
        bool accepted = false;
        bool small = false;
        while (!accepted && !small && damping < too_damped) {
            Eigen::MatrixXd damped = normal;
            damped.diagonal() += damping * normal.diagonal();
            const Eigen::VectorXd change = -models::CompleteFactor(damped).solve(gradient);
            small = change.norm() <= step_tolerance * (1.0 + x0(fitted).norm());
            Eigen::VectorXd next = x0;
            next(fitted) += change;
            auto trial = value(block, all, next, true);
            accepted =
                trial.status == estimator::BlockStatus::ok && change.allFinite() && sum_of_squares(trial.e) <= before;
            damping = accepted ? std::max(damping / 10.0, 1e-12) : damping * 10.0;
            if (!accepted) continue;
            x0 = next;
            now = std::move(trial);
        }
        if (small || !accepted) break;
    }
    return now;
}

SegmentPrediction SeriesResidual::predict_one(const Eigen::VectorXd& all, const Eigen::VectorXd& scales,
                                              const Eigen::VectorXd& relative, std::size_t segment) const {
    const Block block = make_block(segment);
    SegmentPrediction prediction;
    prediction.segment = segment;
    prediction.state = guess(segment, all);
    const estimator::BlockValue now = fit_state(block, all, scales, relative, prediction.state);
    prediction.status = now.status;
    prediction.rms = Eigen::VectorXd::Constant(std::ssize(observed_), std::numeric_limits<double>::quiet_NaN());
    prediction.normalised_rms = std::numeric_limits<double>::quiet_NaN();
    if (now.status != estimator::BlockStatus::ok) return prediction;
    for (Eigen::Index r = 0; r < now.e.size(); ++r) {
        const auto at = static_cast<std::size_t>(r);
        if (block.group[at] < std::ssize(observed_) && block.records[at].sample >= 0)
            prediction.readings.push_back({block.group[at], block.records[at].sample, block.observed[r], now.e[r]});
    }
    double total = 0.0;
    std::size_t records = 0;
    for (Eigen::Index i = 0; i < std::ssize(observed_); ++i) {
        double sum = 0.0;
        std::size_t count = 0;
        for (Eigen::Index r = 0; r < now.e.size(); ++r) {
            if (block.group[static_cast<std::size_t>(r)] != i) continue;
            sum += now.e[r] * now.e[r];
            const double u = standard(block, r, now.e, scales, relative).value;
            total += u * u;
            ++count;
        }
        if (count > 0) prediction.rms[i] = std::sqrt(sum / static_cast<double>(count));
        records += count;
    }
    prediction.normalised_rms = std::sqrt(total / static_cast<double>(records));
    return prediction;
}

std::vector<SegmentPrediction> SeriesResidual::predict(const Eigen::VectorXd& theta, const Eigen::VectorXd& scales,
                                                       const std::vector<std::size_t>& segments,
                                                       const Eigen::VectorXd& relative) const {
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
    if (relative.size() != 0 && relative.size() != std::ssize(groups_)) {
        throw std::invalid_argument(
            fmt::format("prediction: {} relative errors, must be {}", relative.size(), groups_.size()));
    }
    Eigen::VectorXd shares = relative;
    if (shares.size() == 0) {
        shares.setZero(std::ssize(groups_));
        for (std::size_t g = 0; g < groups_.size(); ++g) {
            const auto* errors = std::get_if<estimator::RelativeErrors>(&groups_[g].distribution);
            if (errors != nullptr) shares[static_cast<Eigen::Index>(g)] = errors->relative.value;
        }
    }
    const Eigen::VectorXd all = binding_.values(theta);
    std::vector<SegmentPrediction> predictions(segments.size());
    oneapi::tbb::parallel_for(std::size_t{0}, segments.size(),
                              [&](std::size_t i) { predictions[i] = predict_one(all, scales, shares, segments[i]); });
    return predictions;
}

}  // namespace orbid::orbits
