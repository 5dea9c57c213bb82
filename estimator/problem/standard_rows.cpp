#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/problem/linearisation.hpp"

namespace orbid::estimator {

WhitenedRows standard_rows(const BlockRows& block, const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                           Curvature curvature) {
    WhitenedRows result;
    if (block.rows.size() > 0) {
        const Eigen::VectorXd scale = scales_of(laws, psi);
        result.rows = block.rows;
        whiten(block.channel, *block.cholesky, scale, result.rows);
        result.value = 0.5 * result.rows.rightCols(1).squaredNorm() +
                       0.5 * std::log(2.0 * std::numbers::pi) * static_cast<double>(block.channel.size());
        for (const int c : block.channel)
            result.value += std::log(scale[c]);
        return result;
    }
    return standard_rows(block.parts, laws, psi, curvature);
}

namespace {

/// Whitened rows of one law, written into `rows`. @return -ln p
double write_whitened(const NoiseModel& law, const LawRecords& records, const Eigen::VectorXd& psi, Curvature curvature,
                      Eigen::Ref<Eigen::MatrixXd> rows) {
    if (!law.compressible() || records.observed.size() > 0) {
        const WhitenedRows own = whitened_rows(law, records, law.own(psi), curvature);
        rows = own.rows;
        return own.value;
    }
    // S = A / s, without a matrix in between: links and readings have few rows each.
    const double ln_scale = psi[law.first];
    rows = std::exp(-ln_scale) * records.rows;
    return static_cast<double>(records.count) * (ln_scale + 0.5 * std::log(2.0 * std::numbers::pi)) +
           0.5 * rows.rightCols(1).squaredNorm();
}

}  // namespace

WhitenedRows standard_rows(const std::vector<PartRows>& from, const std::vector<NoiseModel>& laws,
                           const Eigen::VectorXd& psi, Curvature curvature) {
    WhitenedRows result;
    if (from.empty()) return result;
    Eigen::Index count = 0;
    for (const PartRows& part : from)
        count += part.records.rows.rows() * laws[part.law].rows_per_record();
    result.rows.resize(count, from.front().records.rows.cols());
    Eigen::Index row = 0;
    for (const PartRows& part : from) {
        const NoiseModel& law = laws[part.law];
        const Eigen::Index own = part.records.rows.rows() * law.rows_per_record();
        result.value += write_whitened(law, part.records, psi, curvature, result.rows.middleRows(row, own));
        row += own;
    }
    return result;
}

namespace {

/// With a covariance shape: d(L^-1 D^-1 A) = -L^-1 E_g L (L^-1 D^-1 A), E_g picks the rows of the channel.
void shaped_derivative(const BlockRows& block, const std::vector<NoiseModel>& laws, Eigen::Index k,
                       const WhitenedRows& at, WhitenedRows& result) {
    const auto lower = block.cholesky->triangularView<Eigen::Lower>();
    Eigen::MatrixXd picked = lower * at.rows;
    for (std::size_t i = 0; i < block.channel.size(); ++i) {
        const bool own_row = std::any_of(laws.begin(), laws.end(), [&](const NoiseModel& law) {
            return law.first == k && law.channels.front() == block.channel[i];
        });
        if (own_row)
            result.value += 1.0;
        else
            picked.row(static_cast<Eigen::Index>(i)).setZero();
    }
    if (!(result.value > 0.0)) return;
    lower.solveInPlace(picked);
    result.rows = -picked;
    result.value += result.rows.rightCols(1).col(0).dot(at.rows.rightCols(1).col(0));
}

}  // namespace

WhitenedRows standard_rows_derivative(const BlockRows& block, const std::vector<PartRows>& parts,
                                      const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi, Eigen::Index k,
                                      Curvature curvature, const WhitenedRows& at) {
    WhitenedRows result;
    result.rows = Eigen::MatrixXd::Zero(at.rows.rows(), at.rows.cols());
    if (block.rows.size() > 0) {
        shaped_derivative(block, laws, k, at, result);
        return result;
    }
    Eigen::Index row = 0;
    for (const PartRows& part : parts) {
        const NoiseModel& law = laws[part.law];
        if (!law.has(k)) {
            row += part.records.rows.rows() * law.rows_per_record();
            continue;
        }
        if (law.compressible()) {
            // S = A / s.
            const Eigen::Index rows = part.records.rows.rows();
            result.rows.middleRows(row, rows) = -at.rows.middleRows(row, rows);
            result.value =
                static_cast<double>(part.records.count) - at.rows.middleRows(row, rows).rightCols(1).squaredNorm();
            return result;
        }
        const WhitenedRows slope = whitened_rows_slope(law, part.records, law.own(psi), k - law.first, curvature);
        result.rows.middleRows(row, slope.rows.rows()) = slope.rows;
        result.value = slope.value;
        return result;
    }
    return result;
}

}  // namespace orbid::estimator
