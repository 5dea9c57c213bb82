#include "orbits/invariants/cycle_expansion.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <stdexcept>

#include <fmt/format.h>

#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/eigenvalues.hpp"
#include "orbits/invariants/kaplan_yorke.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {
namespace {

// A multiplier this near to modulus 1 makes det(1 - J^r) vanish for some r within rounding.
constexpr double marginal = 1e-9;

// Zeros are those of real polynomials: a real eigenvalue of the companion matrix has an imaginary part of exactly 0
// from Eigen's real Schur form, so no tolerance is needed.

enum class Weight { determinant, zeta, topological };

// One prime cycle in the form of the sums.
struct Term {
    int period = 0;
    double time = 0.0;
    std::vector<std::complex<double>> multipliers;  // largest modulus first
    Eigen::VectorXd ln_modulus;

    [[nodiscard]] double ln_expansion() const { return ln_modulus.cwiseMax(0.0).sum(); }
};

void check_multipliers(const Cycle& cycle, std::size_t number, std::size_t dimension) {
    refuse_record_if(
        cycle.multipliers.size() != dimension || dimension == 0,
        "expand_cycles: cycle {} has {} multipliers, the first one has {}; all need the same, at least one", number,
        cycle.multipliers.size(), dimension);
    bool unstable = false;
    for (const std::complex<double>& value : cycle.multipliers) {
        const double modulus = std::abs(value);
        refuse_record_if(
            !(std::isfinite(modulus) && std::abs(modulus - 1.0) > marginal),
            "expand_cycles: cycle {} has a multiplier of modulus {:f}: must be finite and not 1 (the trivial "
            "multiplier of a flow is left out)",
            number, modulus);
        unstable = unstable || modulus > 1.0;
    }
    refuse_record_if(!unstable, "expand_cycles: cycle {} is stable: an expansion is of unstable cycles", number);
}

void check_partner(std::span<const Cycle> cycles, std::size_t number) {
    const Cycle& cycle = cycles[number];
    if (!cycle.mirror) return;
    const std::size_t partner = *cycle.mirror;
    refuse_record_if(
        !(partner < cycles.size()) || cycles[partner].mirror != number || cycles[partner].period != cycle.period,
        "expand_cycles: cycle {} names a mirror partner that is not in the list with the same period", number);
}

// The cycles up to complete_to, checked.
std::vector<std::size_t> checked(std::span<const Cycle> cycles, const CycleExpansionOptions& options) {
    refuse_if(!(options.complete_to >= 1 && options.complete_to <= 64),
              "expand_cycles: complete_to must be in [1, 64], got {}: only a list that is complete up to a known "
              "period can be expanded",
              options.complete_to);
    std::vector<std::size_t> used;
    for (std::size_t i = 0; i < cycles.size(); ++i) {
        refuse_record_if(!(cycles[i].period >= 1), "expand_cycles: cycle {} has period {}, must be positive", i,
                         cycles[i].period);
        if (cycles[i].period > options.complete_to) continue;
        used.push_back(i);
        check_multipliers(cycles[i], i, cycles[used.front()].multipliers.size());
        check_partner(cycles, i);
        const bool timed = !std::isnan(cycles[used.front()].time);
        refuse_record_if(std::isnan(cycles[i].time) == timed, "expand_cycles: some cycles have times, others not");
        refuse_record_if(timed && !(cycles[i].time > 0.0 && std::isfinite(cycles[i].time)),
                         "expand_cycles: cycle {} has time {:f}, must be positive", i, cycles[i].time);
    }
    refuse_record_if(used.empty(), "expand_cycles: no cycle of period {} or shorter", options.complete_to);
    return used;
}

Term term_of(const Cycle& cycle) {
    Term term{cycle.period, std::isnan(cycle.time) ? cycle.period : cycle.time, cycle.multipliers, {}};
    std::stable_sort(term.multipliers.begin(), term.multipliers.end(),
                     [](const auto& a, const auto& b) { return std::abs(a) > std::abs(b); });
    term.ln_modulus.resize(static_cast<Eigen::Index>(term.multipliers.size()));
    for (std::size_t d = 0; d < term.multipliers.size(); ++d)
        term.ln_modulus[static_cast<Eigen::Index>(d)] = std::log(std::abs(term.multipliers[d]));
    return term;
}

double determinant(const Term& term, int repeats) {
    std::complex<double> product = 1.0;
    for (const std::complex<double>& value : term.multipliers)
        product *= 1.0 - std::pow(value, repeats);
    return product.real();  // conjugate pairs
}

std::vector<int> index_sums(const std::vector<Term>& terms, int longest) {
    std::vector<int> sums(static_cast<std::size_t>(longest), 0);
    for (const Term& term : terms)
        for (int r = 1; r * term.period <= longest; ++r)
            sums[static_cast<std::size_t>(r * term.period - 1)] +=
                determinant(term, r) > 0.0 ? term.period : -term.period;
    return sums;
}

void check_index_sums(const std::vector<int>& sums) {
    if (std::all_of(sums.begin(), sums.end(), [&](int sum) { return sum == sums.front(); })) return;
    const auto most = std::max_element(sums.begin(), sums.end(), [&](int a, int b) {
        return std::count(sums.begin(), sums.end(), a) < std::count(sums.begin(), sums.end(), b);
    });
    const auto odd = std::find_if(sums.begin(), sums.end(), [&](int sum) { return sum != *most; });
    throw DataError(fmt::format(
        "expand_cycles: the list is not complete or has false cycles: the sums of the indices of the points of periods "
        "1, 2, ... {} must be equal for a continuous map; the first that stands out is that of period {}",
        fmt::join(sums, ", "), odd - sums.begin() + 1));
}

// Coefficients Q_0 ... Q_N in z with derivatives; columns of `slope`: s, beta_1, ..., beta_n.
struct Coefficients {
    Eigen::VectorXd value;
    Eigen::MatrixXd slope;
};

Coefficients coefficients(const std::vector<Term>& terms, Weight weight, int longest, double s) {
    const Eigen::Index n = terms.front().ln_modulus.size();
    Eigen::VectorXd trace = Eigen::VectorXd::Zero(longest + 1);
    Eigen::MatrixXd trace_slope = Eigen::MatrixXd::Zero(longest + 1, n + 1);
    for (const Term& term : terms)
        for (int r = 1; r * term.period <= longest; ++r) {
            double size = 1.0;
            if (weight == Weight::determinant) size = std::abs(determinant(term, r));
            if (weight == Weight::zeta) size = std::exp(r * term.ln_expansion());
            const double part = term.period * std::exp(-s * term.time * r) / size;
            trace[r * term.period] += part;
            trace_slope(r * term.period, 0) -= part * term.time * r;
            trace_slope.row(r * term.period).tail(n) += part * r * term.ln_modulus.transpose();
        }
    Coefficients q{Eigen::VectorXd::Zero(longest + 1), Eigen::MatrixXd::Zero(longest + 1, n + 1)};
    q.value[0] = 1.0;
    for (int k = 1; k <= longest; ++k) {
        for (int j = 1; j <= k; ++j) {
            q.value[k] -= trace[j] * q.value[k - j];
            q.slope.row(k) -= trace_slope.row(j) * q.value[k - j] + trace[j] * q.slope.row(k - j);
        }
        q.value[k] /= k;
        q.slope.row(k) /= k;
    }
    return q;
}

// Smallest positive zero of sum_k Q_k z^k: the inverse of the largest positive eigenvalue of the companion matrix.
double leading_zero(const Eigen::VectorXd& q) {
    const Eigen::Index degree = q.size() - 1;
    Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(degree, degree);
    companion.row(0) = -q.tail(degree).transpose();
    companion.diagonal(-1).setOnes();
    if (!companion.allFinite()) return estimator::nan_value;
    double largest = 0.0;
    for (const std::complex<double>& value : models::eigenvalues(companion))
        if (value.imag() == 0.0) largest = std::max(largest, value.real());
    // Zero coefficients at the end leave eigenvalues 0, which rounding moves by its n-th root: far below any that
    // matters, since the sets considered have at most a few symbols and stay for at least a few steps.
    return largest > 1e-3 ? 1.0 / largest : estimator::nan_value;
}

// s with leading zero z = 1, and the slopes ds/dbeta there; nan when there is none.
struct Zero {
    double s = estimator::nan_value;
    double mean_time = estimator::nan_value;
    Eigen::VectorXd slope;
};

Zero zero_in_s(const std::vector<Term>& terms, Weight weight, int longest) {
    const Eigen::Index n = terms.front().ln_modulus.size();
    Zero result;
    result.slope = Eigen::VectorXd::Constant(n, estimator::nan_value);
    double s = 0.0;
    // ln z is convex in s and straight without times: Newton on ln z(s) = 0 ends after one step or a few.
    for (int step = 0; step < 50; ++step) {
        const Coefficients q = coefficients(terms, weight, longest, s);
        const double z = leading_zero(q.value);
        if (!(z > 0.0)) return result;
        double by_z = 0.0;
        Eigen::VectorXd by_rest = Eigen::VectorXd::Zero(n + 1);
        for (int k = longest; k >= 0; --k) {
            if (k > 0) by_z += k * q.value[k] * std::pow(z, k);
            by_rest += q.slope.row(k).transpose() * std::pow(z, k);
        }
        const double ln_z_by_s = -by_rest[0] / by_z;  // mean return time
        if (!std::isfinite(ln_z_by_s) || !(ln_z_by_s > 0.0)) return result;
        const double change = -std::log(z) / ln_z_by_s;
        s += change;
        result.mean_time = ln_z_by_s;
        result.slope = -by_rest.tail(n) / by_rest[0];
        if (std::abs(change) * ln_z_by_s < 1e-13) {
            result.s = s;
            return result;
        }
    }
    return result;
}

CycleExpansionTerm expand(const std::vector<Term>& all, int longest) {
    std::vector<Term> terms;
    std::copy_if(all.begin(), all.end(), std::back_inserter(terms),
                 [&](const Term& term) { return term.period <= longest; });
    CycleExpansionTerm result;
    result.period = longest;
    result.cycles = terms.size();
    result.exponents = Eigen::VectorXd::Constant(all.front().ln_modulus.size(), estimator::nan_value);
    result.conservation = 1.0;
    result.determinant_zero = result.zeta_zero = result.escape_rate = result.metric_entropy = estimator::nan_value;
    result.topological_entropy = result.mean_time = result.dimension = estimator::nan_value;
    if (terms.empty()) return result;
    const Eigen::VectorXd q = coefficients(terms, Weight::determinant, longest, 0.0).value;
    result.coefficient = q[longest];
    result.conservation = q.sum();
    result.determinant_zero = leading_zero(q);
    result.zeta_zero = leading_zero(coefficients(terms, Weight::zeta, longest, 0.0).value);
    const Zero zero = zero_in_s(terms, Weight::determinant, longest);
    result.escape_rate = -zero.s;
    result.exponents = zero.slope;
    result.mean_time = zero.mean_time;
    result.metric_entropy = zero.slope.cwiseMax(0.0).sum() + zero.s;
    result.topological_entropy = zero_in_s(terms, Weight::topological, longest).s;
    result.dimension = kaplan_yorke_dimension(zero.slope);
    return result;
}

// Shifts of the answer by one sd of every independent error, squared and summed. Partners of a mirror pair rest on the
// same data and move together.
void propagate(std::span<const Cycle> cycles, const std::vector<std::size_t>& used, const std::vector<Term>& terms,
               int longest, CycleExpansion& result) {
    const Zero centre = zero_in_s(terms, Weight::determinant, longest);
    double escape_variance = 0.0;
    Eigen::VectorXd variance = Eigen::VectorXd::Zero(result.exponent_sds.size());
    for (std::size_t i = 0; i < used.size(); ++i) {
        const Cycle& cycle = cycles[used[i]];
        const Eigen::Index n = cycle.ln_multiplier_covariance.rows();
        if (n != variance.size() || (cycle.mirror && *cycle.mirror < used[i])) continue;
        const Eigen::MatrixXd root = models::LdltFactor(cycle.ln_multiplier_covariance).root();
        for (Eigen::Index c = 0; c < n; ++c) {
            if (!(root.col(c).norm() > 0.0)) continue;
            std::vector<Term> moved = terms;
            for (std::size_t j = 0; j < used.size(); ++j) {
                if (j != i && !(cycle.mirror && used[j] == *cycle.mirror)) continue;
                for (Eigen::Index d = 0; d < n; ++d) {
                    moved[j].multipliers[static_cast<std::size_t>(d)] *= std::exp(root(d, c));
                    moved[j].ln_modulus[d] += root(d, c);
                }
            }
            const Zero zero = zero_in_s(moved, Weight::determinant, longest);
            escape_variance += (zero.s - centre.s) * (zero.s - centre.s);
            variance += (zero.slope - centre.slope).cwiseAbs2();
        }
    }
    result.escape_rate_sd = std::sqrt(escape_variance);
    result.exponent_sds = variance.cwiseSqrt();
}

}  // namespace

CycleExpansion expand_cycles(std::span<const Cycle> cycles, const CycleExpansionOptions& options) {
    const std::vector<std::size_t> used = checked(cycles, options);
    std::vector<Term> terms;
    for (const std::size_t i : used)
        terms.push_back(term_of(cycles[i]));
    CycleExpansion result;
    result.timed = !std::isnan(cycles[used.front()].time);
    result.index_sums = index_sums(terms, options.complete_to);
    if (options.continuous) check_index_sums(result.index_sums);
    for (int longest = 1; longest <= options.complete_to; ++longest)
        result.by_period.push_back(expand(terms, longest));
    result.exponent_sds = Eigen::VectorXd::Zero(terms.front().ln_modulus.size());
    propagate(cycles, used, terms, options.complete_to, result);
    return result;
}

}  // namespace orbid::orbits
