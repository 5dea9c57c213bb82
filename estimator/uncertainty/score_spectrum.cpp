#include "estimator/uncertainty/score_spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/uncertainty/spectral_shape.hpp"

namespace orbid::estimator {

namespace {

/// Few bins see a rise towards frequency zero that many bury in noise: on flicker (Silverbox, 16 windows) the interval
/// of a mean holds 14 times with 64 bins, 9 times with 256.
constexpr Eigen::Index bins_of_scores = 64;
/// An autoregression of the bins says little about the upper two thirds of their frequencies. With 21 the quantile of t
/// is 2.08 instead of 1.96.
constexpr Eigen::Index bins_per_frequency = 3;
/// Bias of a variance: 3 per cent of an sd. Of 3, 6 and 10 per cent it costs least length at the same coverage.
constexpr double flat = 0.06;
/// One frequency has the quantile 12.7: an interval that says nothing.
constexpr Eigen::Index least_frequencies = 2;
/// Two are taken where the autoregression, which errs itself, says that less than half of the variance would be lost.
constexpr double least_shape = 0.5;
/// Rows at a time: their cosines stay in the cache.
constexpr Eigen::Index rows_at_once = 1024;

}  // namespace

ScoreSpectrum::ScoreSpectrum(std::vector<ScoreRows> blocks, double length, double left)
    : blocks_(std::move(blocks)), length_(length), left_(left) {
    for (const ScoreRows& block : blocks_)
        rank_ = std::max(rank_, block.sensitivity.cols());
    const auto bins = std::clamp<Eigen::Index>(static_cast<Eigen::Index>(length_), 1, bins_of_scores);
    binned_ = Eigen::MatrixXd::Zero(rank_, bins);
    for (const ScoreRows& block : blocks_)
        for (Eigen::Index i = 0; i < block.residual.size(); ++i) {
            const auto bin = static_cast<Eigen::Index>(block.time[i] / length_ * static_cast<double>(bins));
            binned_.col(std::min(bin, bins - 1)) += block.residual[i] * block.sensitivity.row(i).transpose();
        }
}

Eigen::Index ScoreSpectrum::most() const {
    return std::max<Eigen::Index>(1, binned_.cols() / bins_per_frequency);
}

/// cos(pi j t / T), shape (count, frequencies), by the recurrence cos(j a) = 2 cos(a) cos((j - 1) a) - cos((j - 2) a).
Eigen::MatrixXd ScoreSpectrum::cosines(const ScoreRows& block, Eigen::Index first, Eigen::Index count,
                                       Eigen::Index frequencies) const {
    Eigen::MatrixXd result(count, frequencies);
    const Eigen::ArrayXd angle = std::numbers::pi / length_ * block.time.segment(first, count).array();
    result.col(0) = angle.cos();
    for (Eigen::Index j = 1; j < frequencies; ++j) {
        result.col(j) = 2.0 * result.col(0).cwiseProduct(result.col(j - 1));
        if (j > 1)
            result.col(j) -= result.col(j - 2);
        else
            result.col(j).array() -= 1.0;
    }
    return result;
}

ScoreSpectrum::Ratio ScoreSpectrum::along(const Eigen::VectorXd& direction) const {
    const std::vector<double> shape = spectral_shape(binned_.transpose() * direction, most());
    Ratio result;
    result.frequencies = flat_frequencies(shape, flat);
    if (result.frequencies < least_frequencies && shape.size() >= static_cast<std::size_t>(least_frequencies) &&
        shape[least_frequencies - 1] >= least_shape)
        result.frequencies = least_frequencies;
    result.enough = result.frequencies >= least_frequencies;

    const Eigen::Index count = result.frequencies;
    Eigen::VectorXd coefficients = Eigen::VectorXd::Zero(count);
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(count, count);
    Eigen::MatrixXd fitted = Eigen::MatrixXd::Zero(rank_, count);
    for (const ScoreRows& block : blocks_) {
        Eigen::MatrixXd absorbed = Eigen::MatrixXd::Zero(block.latent.cols(), count);
        for (Eigen::Index first = 0; first < block.residual.size(); first += rows_at_once) {
            const Eigen::Index here = std::min(rows_at_once, block.residual.size() - first);
            const auto own = block.sensitivity.middleRows(first, here);
            const Eigen::MatrixXd x = (own * direction).asDiagonal() * cosines(block, first, here, count);
            coefficients.noalias() += x.transpose() * block.residual.segment(first, here);
            expected.noalias() += (block.latent.cols() > 0 ? 1.0 : left_) * (x.transpose() * x);
            fitted.noalias() += own.transpose() * x;
            if (block.latent.cols() > 0) absorbed.noalias() += block.latent.middleRows(first, here).transpose() * x;
        }
        expected.noalias() -= absorbed.transpose() * absorbed;
    }
    expected.noalias() -= fitted.transpose() * fitted;
    const double trace = expected.trace();
    // Nothing is left of the residuals at these frequencies: the fit took all of it.
    if (!(trace > 1e-6 * direction.squaredNorm())) {
        result.enough = false;
        return result;
    }
    result.value = coefficients.squaredNorm() / trace;
    result.degrees_of_freedom = std::clamp(trace * trace / expected.squaredNorm(), 1.0, static_cast<double>(count));
    return result;
}

Eigen::MatrixXd ScoreSpectrum::scatter() const {
    const Eigen::Index frequencies = std::max(most(), 2 * rank_);
    Eigen::MatrixXd coefficients = Eigen::MatrixXd::Zero(rank_, frequencies);
    for (const ScoreRows& block : blocks_)
        for (Eigen::Index first = 0; first < block.residual.size(); first += rows_at_once) {
            const Eigen::Index here = std::min(rows_at_once, block.residual.size() - first);
            coefficients.noalias() +=
                block.sensitivity.middleRows(first, here).transpose() *
                (block.residual.segment(first, here).asDiagonal() * cosines(block, first, here, frequencies));
        }
    return 2.0 / static_cast<double>(frequencies) * (coefficients * coefficients.transpose());
}

}  // namespace orbid::estimator
