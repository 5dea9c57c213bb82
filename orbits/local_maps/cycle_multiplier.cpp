#include "orbits/local_maps/cycle_multiplier.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"

namespace orbid::orbits {
namespace {

// Rounds of the cycle: moduli whose ratio is 0.9 settle to rounding within 350 rounds.
constexpr int maximum_rounds = 400;
constexpr double settled = 1e-14;

// By this round a ratio of 0.9 has brought the frames within 1e-3 of each other; what has not come that near turns for
// ever (complex pair) or too slowly.
constexpr int early_round = 40;
constexpr double early_distance = 1e-3;

// Relative change of a jacobian's entries for the derivative of ln|multipliers|: its error is of the order of 1e-6 of
// the derivative, far below what a covariance needs.
constexpr double difference_step = 1e-6;

bool iterate_orthogonally(const std::vector<Eigen::MatrixXd>& jacobians, CycleMultipliers& result) {
    const Eigen::Index n = jacobians.front().rows();
    Eigen::MatrixXd frame = Eigen::MatrixXd::Identity(n, n);
    Eigen::VectorXd previous = Eigen::VectorXd::Constant(n, std::numeric_limits<double>::infinity());
    for (int round = 0; round < maximum_rounds; ++round) {
        const Eigen::MatrixXd start = frame;
        Eigen::VectorXd logs = Eigen::VectorXd::Zero(n);
        Eigen::VectorXd signs = Eigen::VectorXd::Ones(n);
        for (const Eigen::MatrixXd& jacobian : jacobians) {
            const models::HouseholderFactor factor(jacobian * frame);
            frame = factor.q();
            for (Eigen::Index i = 0; i < n; ++i) {
                const double diagonal = factor.packed()(i, i);
                if (diagonal == 0.0 || !std::isfinite(diagonal)) return false;
                logs[i] += std::log(std::abs(diagonal));
                if (diagonal < 0.0) signs[i] = -signs[i];
            }
        }
        // Settled when the frame returns to itself up to the direction of its columns.
        const Eigen::VectorXd overlap = (start.transpose() * frame).diagonal();
        const bool same_frame = ((overlap.array().abs() - 1.0).abs() < settled).all();
        const bool same_logs = ((logs - previous).array().abs() < 1e-13 * (1.0 + logs.array().abs())).all();
        previous = logs;
        if (round == early_round && ((overlap.array().abs() - 1.0).abs() > early_distance).any()) return false;
        if (!(same_frame && same_logs)) continue;
        if (!std::is_sorted(logs.data(), logs.data() + n, std::greater<>())) return false;
        result.ln_modulus = logs;
        result.values.clear();
        for (Eigen::Index i = 0; i < n; ++i)
            result.values.emplace_back((overlap[i] < 0.0 ? -signs[i] : signs[i]) * std::exp(logs[i]), 0.0);
        return true;
    }
    return false;
}

void from_product(const std::vector<Eigen::MatrixXd>& jacobians, CycleMultipliers& result) {
    const Eigen::Index n = jacobians.front().rows();
    Eigen::MatrixXd product = Eigen::MatrixXd::Identity(n, n);
    double ln_scale = 0.0;  // kept apart: long products overflow
    for (const Eigen::MatrixXd& jacobian : jacobians) {
        product = jacobian * product;
        const double size = product.norm();
        if (size > 0.0 && std::isfinite(size)) {
            product /= size;
            ln_scale += std::log(size);
        }
    }
    const Eigen::VectorXcd found = models::eigenvalues(product);
    std::vector<std::complex<double>> values(found.data(), found.data() + n);
    // Conjugates have equal moduli to the last bit and come with the positive imaginary part first: a stable sort keeps
    // that.
    std::stable_sort(values.begin(), values.end(),
                     [](std::complex<double> a, std::complex<double> b) { return std::abs(a) > std::abs(b); });
    result.values.clear();
    result.ln_modulus.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const std::complex<double> value = values[static_cast<std::size_t>(i)];
        result.ln_modulus[i] = std::log(std::abs(value)) + ln_scale;
        result.values.push_back(value * std::exp(ln_scale));
    }
}

}  // namespace

CycleMultipliers cycle_multipliers(const std::vector<Eigen::MatrixXd>& jacobians) {
    CycleMultipliers result;
    if (!iterate_orthogonally(jacobians, result)) from_product(jacobians, result);
    return result;
}

Eigen::MatrixXd ln_multiplier_derivative(const std::vector<Eigen::MatrixXd>& jacobians) {
    const Eigen::Index n = jacobians.front().rows();
    Eigen::MatrixXd result(n, static_cast<Eigen::Index>(jacobians.size()) * n * n);
    std::vector<Eigen::MatrixXd> moved = jacobians;
    Eigen::Index column = 0;
    for (Eigen::MatrixXd& jacobian : moved) {
        const double step = difference_step * std::max(jacobian.norm(), difference_step);
        for (Eigen::Index entry = 0; entry < n * n; ++entry) {
            const double kept = jacobian.data()[entry];
            jacobian.data()[entry] = kept + step;
            const Eigen::VectorXd above = cycle_multipliers(moved).ln_modulus;
            jacobian.data()[entry] = kept - step;
            const Eigen::VectorXd below = cycle_multipliers(moved).ln_modulus;
            jacobian.data()[entry] = kept;
            // A multiplier that is zero to rounding has no logarithm and no derivative; its variance stays at the
            // floor.
            const Eigen::VectorXd slope = (above - below) / (2.0 * step);
            result.col(column++) = slope.array().isFinite().select(slope, 0.0);
        }
    }
    return result;
}

}  // namespace orbid::orbits
