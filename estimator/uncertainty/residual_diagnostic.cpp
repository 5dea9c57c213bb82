#include "estimator/uncertainty/residual_diagnostic.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

#include <boost/math/distributions/students_t.hpp>

#include "estimator/interface/not_finite.hpp"
#include "estimator/uncertainty/autocorrelation.hpp"

namespace orbid::estimator {

namespace {

void check(const ResidualSample& sample, const DiagnosticOptions& options) {
    const Eigen::Index n = sample.residual.size();
    if (!sample.residual.allFinite()) throw std::invalid_argument("residual diagnostic: residuals must be finite");
    if (sample.leverage.size() > 0) {
        if (sample.leverage.size() != n)
            throw std::invalid_argument("residual diagnostic: " + std::to_string(sample.leverage.size()) +
                                        " leverages for " + std::to_string(n) + " records");
        for (const double h : sample.leverage)
            if (!(h >= 0.0) || !(h <= 1.0))
                throw std::invalid_argument("residual diagnostic: leverage = " + std::to_string(h) +
                                            " must lie between 0 and 1");
    }
    if (!(sample.fitted >= 0.0))
        throw std::invalid_argument("residual diagnostic: fitted = " + std::to_string(sample.fitted) +
                                    " must not be negative");
    Eigen::Index total = 0;
    for (const Eigen::Index length : sample.sequences) {
        if (length < 0) throw std::invalid_argument("residual diagnostic: a sequence has a negative length");
        total += length;
    }
    if (!sample.sequences.empty() && total != n)
        throw std::invalid_argument("residual diagnostic: sequences of " + std::to_string(total) + " records, " +
                                    std::to_string(n) + " are given");
    if (options.lags < 0)
        throw std::invalid_argument("lags = " + std::to_string(options.lags) + " must not be negative");
    if (!(options.outlier_level > 0.0) || !(options.outlier_level < 1.0))
        throw std::invalid_argument("outlier_level = " + std::to_string(options.outlier_level) +
                                    " must lie between 0 and 1");
}

double two_sided_t(double t, double dof) {
    if (!std::isfinite(t)) return 0.0;
    const boost::math::students_t_distribution<double> reference(dof);
    return 2.0 * boost::math::cdf(boost::math::complement(reference, std::abs(t)));
}

/// Leverages within this of 1 leave nothing of the residual but rounding.
constexpr double free_leverage = 1e-10;

void look_at_records(const ResidualSample& sample, const DiagnosticOptions& options, ResidualDiagnostic& result) {
    const Eigen::Index n = sample.residual.size();
    const auto count = static_cast<double>(n);
    const bool known = sample.leverage.size() > 0;
    const Eigen::VectorXd h =
        known ? sample.leverage : Eigen::VectorXd::Constant(n, std::min(sample.fitted / count, 1.0));
    const double fitted = h.sum();
    const double dof = count - fitted;
    result.studentised = Eigen::VectorXd::Constant(n, nan_value);
    const double variance = sample.scale_estimated ? sample.residual.squaredNorm() / dof : 1.0;
    if (!(variance > 0.0) || !std::isfinite(variance)) return;
    std::vector<Influence> all;
    for (Eigen::Index i = 0; i < n; ++i) {
        const double rest = 1.0 - h[i];
        if (!(rest > free_leverage)) {
            if (known) all.push_back({i, h[i], std::numeric_limits<double>::infinity()});
            continue;
        }
        const double square = sample.residual[i] * sample.residual[i] / (variance * rest);
        if (known) all.push_back({i, h[i], square * h[i] / (std::max(fitted, 1e-300) * rest)});
        const double sign = sample.residual[i] < 0.0 ? -1.0 : 1.0;
        if (!sample.scale_estimated) {
            result.studentised[i] = sign * std::sqrt(square);
        } else if (dof > 1.0) {
            // The largest square there can be is dof: the rest of the records then fit exactly.
            const double left = std::max(dof - square, 0.0);
            result.studentised[i] = sign * std::sqrt(square * (dof - 1.0) / left);
        }
        const double t = result.studentised[i];
        if (std::isnan(t)) continue;
        const double p =
            sample.scale_estimated ? two_sided_t(t, dof - 1.0) : std::erfc(std::abs(t) / std::numbers::sqrt2);
        if (count * p < options.outlier_level) result.outliers.push_back({i, t, count * p});
    }
    std::stable_sort(result.outliers.begin(), result.outliers.end(),
                     [](const Outlier& a, const Outlier& b) { return a.p < b.p; });
    for (const Influence& record : all) {
        if (record.leverage > 2.0 * fitted / count) result.leverages.push_back(record);
        if (record.cook > 4.0 / count) result.influential.push_back(record);
    }
    std::stable_sort(result.leverages.begin(), result.leverages.end(),
                     [](const Influence& a, const Influence& b) { return a.leverage > b.leverage; });
    std::stable_sort(result.influential.begin(), result.influential.end(),
                     [](const Influence& a, const Influence& b) { return a.cook > b.cook; });
    result.leverages.resize(std::min(result.leverages.size(), options.listed));
    result.influential.resize(std::min(result.influential.size(), options.listed));
}

}  // namespace

ResidualDiagnostic diagnose(const ResidualSample& sample, const DiagnosticOptions& options) {
    check(sample, options);
    const Eigen::VectorXd& e = sample.residual;
    const Eigen::Index n = e.size();
    const auto count = static_cast<double>(n);
    ResidualDiagnostic result;
    result.count = n;
    result.mean = n > 0 ? e.mean() : nan_value;
    result.sd = n > 1 ? std::sqrt((e.array() - result.mean).square().sum() / (count - 1.0)) : nan_value;
    result.mean_test = undefined_test;
    if (result.sd > 0.0) {
        const double t = result.mean / result.sd * std::sqrt(count);
        result.mean_test = {t, two_sided_t(t, count - 1.0)};
    }
    result.skewness = sample_skewness(e);
    result.kurtosis = sample_kurtosis(e);
    result.anderson_darling = anderson_darling(e);
    result.shapiro_wilk = shapiro_wilk(e);
    result.skewness_test = skewness_test(e);
    result.kurtosis_test = kurtosis_test(e);
    result.lag1 = nan_value;
    result.ljung_box = result.runs = undefined_test;
    if (!sample.sequences.empty()) {
        std::vector<Eigen::VectorXd> sequences;
        Eigen::Index first = 0;
        for (const Eigen::Index length : sample.sequences) {
            sequences.emplace_back(e.segment(first, length));
            first += length;
        }
        result.lag1 = autocorrelation(sequences).lag1;
        const int lags =
            options.lags > 0 ? options.lags : std::max(1, static_cast<int>(std::min<Eigen::Index>(10, n / 5)));
        result.ljung_box = ljung_box(sequences, lags);
        result.runs = runs_test(sequences);
    }
    look_at_records(sample, options, result);
    return result;
}

}  // namespace orbid::estimator
