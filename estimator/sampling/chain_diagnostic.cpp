#include "estimator/sampling/chain_diagnostic.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include <boost/math/distributions/beta.hpp>
#include <boost/math/distributions/normal.hpp>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

/// Below this many draws per chain a half is too short for the first pairs of autocorrelations.
constexpr Eigen::Index fewest = 12;

bool useless(const Eigen::MatrixXd& draws) {
    return draws.rows() < fewest || draws.cols() == 0 || !draws.allFinite() || !(draws.maxCoeff() > draws.minCoeff());
}

/// Splits every chain in two, without the middle one of odd draws: a drifting chain then disagrees with itself.
Eigen::MatrixXd halves(const Eigen::MatrixXd& draws) {
    const Eigen::Index half = draws.rows() / 2;
    Eigen::MatrixXd split(half, 2 * draws.cols());
    split << draws.topRows(half), draws.bottomRows(half);
    return split;
}

/// Normal scores of the ranks over all draws, ties at their mean rank; Blom's offset 3/8.
Eigen::MatrixXd normal_scores(const Eigen::MatrixXd& draws) {
    const auto count = static_cast<std::size_t>(draws.size());
    std::vector<Eigen::Index> order(count);
    std::iota(order.begin(), order.end(), Eigen::Index{0});
    const double* value = draws.data();
    std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) { return value[a] < value[b]; });
    const boost::math::normal_distribution<double> normal;
    Eigen::MatrixXd scores(draws.rows(), draws.cols());
    for (std::size_t first = 0; first < count;) {
        std::size_t end = first + 1;
        while (end < count && value[order[end]] == value[order[first]])
            ++end;
        const double rank = 0.5 * static_cast<double>(first + 1 + end);
        const double score = quantile(normal, (rank - 0.375) / (static_cast<double>(count) + 0.25));
        for (; first < end; ++first)
            scores.data()[order[first]] = score;
    }
    return scores;
}

double variance(const Eigen::VectorXd& x) {
    return (x.array() - x.mean()).square().sum() / static_cast<double>(x.size() - 1);
}

/// sqrt((N - 1 + N var(means) / mean(variances)) / N) of chains of N draws.
double rhat(const Eigen::MatrixXd& chains) {
    const auto n = static_cast<double>(chains.rows());
    double within = 0.0;
    for (Eigen::Index c = 0; c < chains.cols(); ++c)
        within += variance(chains.col(c)) / static_cast<double>(chains.cols());
    const double between = n * variance(chains.colwise().mean().transpose());
    return std::sqrt((between / within + n - 1.0) / n);
}

/// Count of draws over the integrated autocorrelation time, the sum cut off by Geyer's initial monotone sequence.
double effective_sample_size(const Eigen::MatrixXd& chains) {
    if (!(chains.maxCoeff() > chains.minCoeff())) return nan_value;
    const Eigen::Index rows = chains.rows();
    const auto n = static_cast<double>(rows);
    const Eigen::MatrixXd centred = chains.rowwise() - chains.colwise().mean();
    // Mean over the chains. The sequence ends after a few times the autocorrelation time, so sums lag by lag cost less
    // than a Fourier transform of everything.
    const auto autocovariance = [&](Eigen::Index lag) {
        return centred.topRows(rows - lag).cwiseProduct(centred.bottomRows(rows - lag)).sum() /
               (n * static_cast<double>(chains.cols()));
    };
    const double at_zero = autocovariance(0);
    const double within = at_zero * n / (n - 1.0);
    const double total = at_zero + (chains.cols() > 1 ? variance(chains.colwise().mean().transpose()) : 0.0);
    const auto correlation = [&](Eigen::Index lag) { return 1.0 - (within - autocovariance(lag)) / total; };

    std::vector<double> rho{1.0, correlation(1)};
    Eigen::Index last = 0;
    double even = 1.0;
    double odd = rho[1];
    while (last < rows - 5 && even + odd > 0.0) {
        last += 2;
        even = correlation(last);
        odd = correlation(last + 1);
        const bool positive = even + odd >= 0.0;
        rho.push_back(positive ? even : 0.0);
        rho.push_back(positive ? odd : 0.0);
    }
    const auto end = static_cast<std::size_t>(last);
    if (even > 0.0) rho[end] = even;
    for (std::size_t t = 2; t + 2 <= end; t += 2)
        if (rho[t] + rho[t + 1] > rho[t - 2] + rho[t - 1]) rho[t] = rho[t + 1] = 0.5 * (rho[t - 2] + rho[t - 1]);
    const double time = -1.0 + 2.0 * std::accumulate(rho.begin(), rho.begin() + last, 0.0) + rho[end];
    const auto count = static_cast<double>(chains.size());
    // Antithetic chains may be worth more than independent draws, but by how much is not known well.
    return count / std::max(time, 1.0 / std::log10(count));
}

std::vector<double> sorted(const Eigen::MatrixXd& draws) {
    std::vector<double> values(draws.data(), draws.data() + draws.size());
    std::sort(values.begin(), values.end());
    return values;
}

}  // namespace

double rank_normalised_rhat(const Eigen::MatrixXd& draws) {
    if (useless(draws)) return nan_value;
    const Eigen::MatrixXd folded = (draws.array() - sample_quantile(draws, 0.5)).abs();
    const double bulk = rhat(normal_scores(halves(draws)));
    // A distribution on two values has no spread about its median to compare.
    return useless(folded) ? bulk : std::max(bulk, rhat(normal_scores(halves(folded))));
}

double bulk_effective_sample_size(const Eigen::MatrixXd& draws) {
    return useless(draws) ? nan_value : effective_sample_size(normal_scores(halves(draws)));
}

double tail_effective_sample_size(const Eigen::MatrixXd& draws) {
    const double low = quantile_effective_sample_size(draws, 0.05);
    const double high = quantile_effective_sample_size(draws, 0.95);
    return std::isnan(low) ? low : std::isnan(high) ? high : std::min(low, high);
}

double mean_effective_sample_size(const Eigen::MatrixXd& draws) {
    return useless(draws) ? nan_value : effective_sample_size(halves(draws));
}

double quantile_effective_sample_size(const Eigen::MatrixXd& draws, double probability) {
    if (useless(draws)) return nan_value;
    const double bound = sample_quantile(draws, probability);
    return effective_sample_size(halves((draws.array() <= bound).cast<double>().matrix()));
}

double mean_standard_error(const Eigen::MatrixXd& draws) {
    if (useless(draws)) return nan_value;
    return std::sqrt(variance(draws.reshaped()) / mean_effective_sample_size(draws));
}

double sd_standard_error(const Eigen::MatrixXd& draws) {
    if (useless(draws)) return nan_value;
    const Eigen::MatrixXd square = (draws.array() - draws.mean()).square();
    const double second = square.mean();
    const double fourth = square.array().square().mean();
    return std::sqrt((fourth - second * second) / mean_effective_sample_size(square) / second / 4.0);
}

double quantile_standard_error(const Eigen::MatrixXd& draws, double probability) {
    const double effective = quantile_effective_sample_size(draws, probability);
    if (std::isnan(effective)) return nan_value;
    // The probability below a sample quantile is beta distributed. One standard error is half the distance between the
    // order statistics at the normal one-sd probabilities.
    const boost::math::beta_distribution<double> beta(effective * probability + 1.0,
                                                      effective * (1.0 - probability) + 1.0);
    constexpr double below_one_sd = 0.1586552539314571;
    const std::vector<double> ordered = sorted(draws);
    const auto count = static_cast<double>(ordered.size());
    const double low = std::max(std::floor(quantile(beta, below_one_sd) * count), 1.0);
    const double high = std::min(std::ceil(quantile(complement(beta, below_one_sd)) * count), count);
    return 0.5 * (ordered[static_cast<std::size_t>(high) - 1] - ordered[static_cast<std::size_t>(low) - 1]);
}

double sample_quantile(const Eigen::MatrixXd& draws, double probability) {
    if (draws.size() == 0) return nan_value;
    const std::vector<double> ordered = sorted(draws);
    const double place = static_cast<double>(ordered.size() - 1) * probability;
    const auto below = static_cast<std::size_t>(place);
    const double share = place - static_cast<double>(below);
    if (!(share > 0.0)) return ordered[below];
    return (1.0 - share) * ordered[below] + share * ordered[below + 1];
}

}  // namespace orbid::estimator
