#include "orbits/local_maps/noise_level.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/median.hpp"
#include "orbits/local_maps/cross_validation.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {
namespace {

constexpr std::size_t least_points = 64;

// Places of the final fits: the standard error of a variance is then about 2 %. Runs of consecutive points, because
// every point but a run's ends serves two products.
constexpr std::size_t most_places = 1 << 13;
constexpr std::size_t run_length = 64;

// Blocks of places whose scatter gives the standard error.
constexpr std::size_t blocks = 16;

// A residual beyond this many local sds is a torn neighbourhood or a wild reading.
constexpr double gate = 5.0;

// Reading errors that explain less than this share of the residuals are only bounded.
constexpr double resolved_share = 0.5;

// Correlations beyond 0.98 between two coordinates are not believed: their standard errors are of that order.
constexpr double least_eigenvalue = 0.01;

// Standard errors by which some variance must exceed zero.
constexpr double significant = 3.0;

// Starts of the runs: evenly over the series.
std::vector<std::size_t> places_in_runs(const SectionPoints& points) {
    const std::size_t runs = most_places / run_length;
    std::vector<std::size_t> places;
    const std::size_t stride = std::max(run_length, points.size() / runs);
    for (std::size_t start = 0; start < points.size(); start += stride)
        for (std::size_t t = start; t < std::min(start + run_length, points.size()); ++t)
            if (points.has_image(t)) places.push_back(t);
    return places;
}

// The i-th of the n (n + 1) / 2 unit matrices of symmetric matrices.
std::vector<Eigen::MatrixXd> symmetric_units(Eigen::Index n) {
    std::vector<Eigen::MatrixXd> units;
    for (Eigen::Index a = 0; a < n; ++a)
        for (Eigen::Index b = a; b < n; ++b) {
            Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(n, n);
            unit(a, b) = unit(b, a) = 1.0;
            units.push_back(std::move(unit));
        }
    return units;
}

// Normal equations of the least-squares problem for S, its distinct entries as unknowns.
struct Normal {
    Eigen::MatrixXd matrix;
    Eigen::VectorXd right;
    explicit Normal(Eigen::Index unknowns)
        : matrix(Eigen::MatrixXd::Zero(unknowns, unknowns)), right(Eigen::VectorXd::Zero(unknowns)) {}
    void add(const std::vector<Eigen::MatrixXd>& columns, const Eigen::MatrixXd& target) {
        for (std::size_t i = 0; i < columns.size(); ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            right[row] += columns[i].cwiseProduct(target).sum();
            for (std::size_t j = 0; j < columns.size(); ++j)
                matrix(row, static_cast<Eigen::Index>(j)) += columns[i].cwiseProduct(columns[j]).sum();
        }
    }
};

class Whitening {
public:
    explicit Whitening(const CrossValidation& fit) : factor_(fit.covariance) {}
    [[nodiscard]] Eigen::MatrixXd operator()(Eigen::MatrixXd m) const {
        factor_.solve_lower_in_place(m);
        return m;
    }

private:
    models::CholeskyFactor factor_;
};

bool within_gate(const CrossValidation& fit) {
    const double square = Whitening(fit)(fit.residual).squaredNorm();
    return square <= gate * gate * static_cast<double>(fit.residual.size());
}

Eigen::MatrixXd assembled(const Eigen::VectorXd& entries, const std::vector<Eigen::MatrixXd>& units) {
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(units.front().rows(), units.front().cols());
    for (std::size_t i = 0; i < units.size(); ++i)
        result += entries[static_cast<Eigen::Index>(i)] * units[i];
    return result;
}

// The least-squares S of the products of successive residuals, and its standard errors.
struct SuccessiveProducts {
    Eigen::MatrixXd estimate;
    Eigen::VectorXd sds;  // of the variances
};

SuccessiveProducts solve_products(Eigen::Index n, const std::vector<std::size_t>& places,
                                  const std::vector<CrossValidation>& fits, const std::vector<char>& good) {
    const std::vector<Eigen::MatrixXd> units = symmetric_units(n);
    const auto unknowns = static_cast<Eigen::Index>(units.size());
    std::vector<Normal> parts(blocks, Normal(unknowns));
    for (std::size_t i = 0; i + 1 < fits.size(); ++i) {
        if (!good[i] || !good[i + 1] || places[i + 1] != places[i] + 1) continue;
        const Whitening here(fits[i]), next(fits[i + 1]);
        const Eigen::MatrixXd target = -next(fits[i + 1].residual) * here(fits[i].residual).transpose();
        std::vector<Eigen::MatrixXd> columns;
        for (const Eigen::MatrixXd& unit : units)
            columns.emplace_back(here((next(fits[i + 1].gradient * unit)).transpose()).transpose());
        parts[i * blocks / fits.size()].add(columns, target);
    }
    Normal all(unknowns);
    for (const Normal& part : parts) {
        all.matrix += part.matrix;
        all.right += part.right;
    }
    const models::LdltFactor solver(all.matrix);
    // Scatter of the blocks' contributions about the common solution.
    Eigen::VectorXd scatter = Eigen::VectorXd::Zero(unknowns);
    for (const Normal& part : parts) {
        const Eigen::VectorXd explained = part.matrix * solver.solve(all.right);
        scatter += solver.solve(Eigen::VectorXd(part.right - explained)).cwiseAbs2();
    }
    SuccessiveProducts result{assembled(solver.solve(all.right), units), Eigen::VectorXd(n)};
    for (Eigen::Index d = 0, i = 0; d < n; i += n - d, ++d)
        result.sds[d] = std::sqrt(scatter[i]);
    return result;
}

// Median share of the residuals that reading errors of this covariance explain.
double explained_share(const std::vector<CrossValidation>& fits, const Eigen::MatrixXd& estimate) {
    std::vector<double> shares;
    for (const CrossValidation& fit : fits) {
        const Eigen::MatrixXd expected = estimate + fit.gradient * estimate * fit.gradient.transpose();
        const Whitening white(fit);
        shares.push_back(white(white(expected).transpose()).trace() / static_cast<double>(estimate.rows()));
    }
    return models::upper_median(shares);
}

// Positive definite matrix near an estimate: a variance is at least its standard error, eigenvalues of the correlation
// at least a small part of the largest, which the scatter of an estimate would not respect.
Eigen::MatrixXd raised(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& standard_errors) {
    const Eigen::VectorXd variances = matrix.diagonal().cwiseMax(standard_errors).cwiseMax(rounding_variance);
    const Eigen::VectorXd unit = variances.cwiseSqrt();
    Eigen::MatrixXd correlation = unit.cwiseInverse().asDiagonal() * matrix * unit.cwiseInverse().asDiagonal();
    correlation.diagonal().setOnes();
    const models::SymmetricEigen eigen = models::symmetric_eigen(correlation);
    const Eigen::VectorXd values = eigen.values.cwiseMax(least_eigenvalue * static_cast<double>(matrix.rows()));
    correlation = eigen.vectors * values.asDiagonal() * eigen.vectors.transpose();
    const Eigen::VectorXd back = unit.cwiseQuotient(correlation.diagonal().cwiseSqrt());
    return back.asDiagonal() * correlation * back.asDiagonal();
}

// A diagonal S for which S + A S A' has the size of the residuals: a few rounds of multiplicative updates, which keep
// it positive.
Eigen::VectorXd bounding_variances(const std::vector<CrossValidation>& fits) {
    const Eigen::Index n = fits.front().residual.size();
    Eigen::VectorXd variances = Eigen::VectorXd::Zero(n);
    for (Eigen::Index d = 0; d < n; ++d) {
        std::vector<double> values;
        for (const CrossValidation& fit : fits)
            values.push_back(fit.covariance(d, d) / (1.0 + fit.gradient.row(d).squaredNorm()));
        variances[d] = std::max(models::upper_median(std::move(values)), rounding_variance);
    }
    constexpr int rounds = 20;
    for (int round = 0; round < rounds; ++round) {
        Eigen::VectorXd found = Eigen::VectorXd::Zero(n), expected = Eigen::VectorXd::Zero(n);
        for (const CrossValidation& fit : fits) {
            const Eigen::VectorXd own = variances + fit.gradient.cwiseAbs2() * variances;
            for (Eigen::Index d = 0; d < n; ++d) {
                // Share of coordinate d in the expected square of every component of the residual.
                const Eigen::VectorXd weight = fit.gradient.col(d).cwiseAbs2() + Eigen::VectorXd::Unit(n, d);
                const Eigen::VectorXd share = weight.cwiseQuotient(own);
                found[d] += share.dot(fit.covariance.diagonal().cwiseQuotient(own).cwiseMin(gate * gate));
                expected[d] += share.sum();
            }
        }
        variances = variances.cwiseProduct(found.cwiseQuotient(expected)).cwiseMax(rounding_variance);
    }
    return variances;
}

}  // namespace

NoiseLevel noise_level(const SectionPoints& points, const NeighbourIndex& grid) {
    refuse_if(!(points.image_count() >= least_points), "noise_level: needs at least {} points with an image, got {}",
              least_points, points.image_count());
    const Eigen::Index n = points.dimension();
    const Eigen::VectorXd& scale = points.scale();
    const std::vector<std::size_t> places = places_in_runs(points);
    NoiseLevel level;
    level.covariance = scale.cwiseAbs2().asDiagonal();
    level.relative_error = Eigen::VectorXd::Constant(n, std::numeric_limits<double>::quiet_NaN());
    const std::optional<FitSize> choice = best_held_out_size(points, grid, places);
    if (!choice) return level;
    const std::vector<CrossValidation> fits = held_out_fits(points, grid, places, *choice);
    std::vector<CrossValidation> usable;
    std::vector<char> good(fits.size(), 0);
    for (std::size_t i = 0; i < fits.size(); ++i)
        if (fits[i].usable && within_gate(fits[i])) {
            good[i] = 1;
            usable.push_back(fits[i]);
        }
    if (usable.size() < blocks) return level;

    const auto [estimate, sds] = solve_products(n, places, fits, good);
    const bool beyond = (estimate.diagonal().array() > significant * sds.array()).any();
    level.resolved = beyond && explained_share(usable, estimate) > resolved_share;
    Eigen::MatrixXd scaled;
    if (level.resolved) {
        scaled = raised(estimate, sds);
        level.relative_error = sds.cwiseQuotient(scaled.diagonal());
    } else {
        scaled = bounding_variances(usable).asDiagonal();
    }
    level.covariance = scale.asDiagonal() * scaled * scale.asDiagonal();
    return level;
}

}  // namespace orbid::orbits
