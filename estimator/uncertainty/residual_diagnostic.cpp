#include "estimator/uncertainty/residual_diagnostic.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <boost/math/distributions/students_t.hpp>

#include "estimator/interface/not_finite.hpp"
#include "estimator/uncertainty/autocorrelation.hpp"

namespace orbid::estimator {

namespace {

void check(const ResidualSample& sample) {
    const Eigen::Index n = sample.residual.size();
    if (!sample.residual.allFinite()) throw std::invalid_argument("residual diagnostic: residuals must be finite");
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
}

double two_sided_t(double t, double dof) {
    if (!std::isfinite(t)) return 0.0;
    const boost::math::students_t_distribution<double> reference(dof);
    return 2.0 * boost::math::cdf(boost::math::complement(reference, std::abs(t)));
}

/// Records whose probability, times their number (Bonferroni), is below this are outliers.
constexpr double outlier_level = 0.05;
/// A fitted share within this of 1 leaves nothing of the residuals but rounding.
constexpr double free_leverage = 1e-10;

std::vector<Outlier> outliers_of(const ResidualSample& sample) {
    std::vector<Outlier> result;
    const Eigen::Index n = sample.residual.size();
    const auto count = static_cast<double>(n);
    const Eigen::VectorXd h = Eigen::VectorXd::Constant(n, std::min(sample.fitted / count, 1.0));
    const double dof = count - h.sum();
    const double variance = sample.scale_estimated ? sample.residual.squaredNorm() / dof : 1.0;
    if (!(variance > 0.0) || !std::isfinite(variance)) return result;
    for (Eigen::Index i = 0; i < n; ++i) {
        const double rest = 1.0 - h[i];
        if (!(rest > free_leverage) || (sample.scale_estimated && !(dof > 1.0))) continue;
        const double square = sample.residual[i] * sample.residual[i] / (variance * rest);
        // The largest square there can be is dof: the rest of the records then fit exactly.
        const double left = std::max(dof - square, 0.0);
        const double size = std::sqrt(sample.scale_estimated ? square * (dof - 1.0) / left : square);
        const double t = (sample.residual[i] < 0.0 ? -1.0 : 1.0) * size;
        if (std::isnan(t)) continue;
        const double p = sample.scale_estimated ? two_sided_t(t, dof - 1.0) : two_sided(t);
        if (count * p < outlier_level) result.push_back({i, t, count * p});
    }
    std::stable_sort(result.begin(), result.end(), [](const Outlier& a, const Outlier& b) { return a.p < b.p; });
    return result;
}

}  // namespace

ResidualDiagnostic diagnose(const ResidualSample& sample) {
    check(sample);
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
        result.ljung_box = ljung_box(sequences, std::max(1, static_cast<int>(std::min<Eigen::Index>(10, n / 5))));
        result.runs = runs_test(sequences);
    }
    result.outliers = outliers_of(sample);
    return result;
}

}  // namespace orbid::estimator
