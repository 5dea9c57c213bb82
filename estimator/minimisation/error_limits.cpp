#include "estimator/minimisation/error_limits.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// Sums over the records of each channel.
struct ChannelSums {
    Eigen::VectorXd square;    ///< of residuals
    Eigen::VectorXd rounding;  ///< of what a relative change of one in z and theta does to them
};

ChannelSums channel_sums(const Problem& problem, const BlockSet& set, const State& state,
                         const std::vector<BlockRows>& rows) {
    const auto channels = static_cast<Eigen::Index>(problem.channels.size());
    const Eigen::VectorXd size = sizes(problem, state.theta);
    ChannelSums sums{Eigen::VectorXd::Zero(channels), Eigen::VectorXd::Zero(channels)};
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const BlockRows& block = rows[b];
        const Eigen::VectorXd& z = state.latents[set.blocks[b].residual][set.blocks[b].block];
        const auto add = [&](const auto& row, Eigen::Index c) {
            sums.square[c] += row[row.size() - 1] * row[row.size() - 1];
            const Eigen::Index before = row.size() - 1 - size.size();
            sums.rounding[c] += row.head(block.latents).transpose().cwiseProduct(z).squaredNorm() +
                                row.segment(before, size.size()).transpose().cwiseProduct(size).squaredNorm();
            if (before == block.latents) return;
            const ActiveBlock& next = set.blocks[static_cast<std::size_t>(block.next)];
            sums.rounding[c] += row.segment(block.latents, block.next_latents)
                                    .transpose()
                                    .cwiseProduct(state.latents[next.residual][next.block])
                                    .squaredNorm();
        };
        for (const std::vector<PartRows>* parts : {&block.parts, &block.linked_parts})
            for (const PartRows& part : *parts) {
                const std::vector<int>& own = problem.laws[part.law].channels;
                const Eigen::Index each = part.records.rows.rows() / static_cast<Eigen::Index>(own.size());
                for (Eigen::Index i = 0; i < part.records.rows.rows(); ++i)
                    add(part.records.rows.row(i), own[static_cast<std::size_t>(i / std::max<Eigen::Index>(each, 1))]);
            }
        if (block.rows.size() == 0) continue;
        Eigen::MatrixXd whitened = block.rows;
        whiten(block.channel, *block.cholesky, Eigen::VectorXd::Ones(channels), whitened);
        for (Eigen::Index i = 0; i < whitened.rows(); ++i)
            add(whitened.row(i), block.channel[static_cast<std::size_t>(i)]);
    }
    set.spread.sum(sums.square);
    set.spread.sum(sums.rounding);
    return sums;
}

}  // namespace

ErrorLimits error_limits(const Problem& problem, const BlockSet& set, const State& state,
                         const std::vector<BlockRows>& rows, const Eigen::VectorXd& latent_fit) {
    const ChannelSums sums = channel_sums(problem, set, state, rows);
    ErrorLimits limits;
    limits.floor.resize(state.psi.size());
    limits.ceiling.resize(state.psi.size());
    limits.size = state.psi;
    for (const NoiseModel& law : problem.laws) {
        Eigen::Index response = 0;
        for (std::size_t j = 0; j < law.coordinates.size(); ++j) {
            const ErrorCoordinate& coordinate = law.coordinates[j];
            const Eigen::Index k = law.first + static_cast<Eigen::Index>(j);
            limits.floor[k] = coordinate.lower;
            limits.ceiling[k] = coordinate.upper;
            // Scales: the first parameter of a law, and the diagonal of a full covariance.
            const bool scale = law.joint() ? coordinate.kind == ErrorCoordinate::Kind::log : j == 0;
            if (!scale) continue;
            const int c = law.channels[static_cast<std::size_t>(law.joint() ? response++ : 0)];
            const double count = std::max(set.count[c], 1.0);
            const double least = std::log(std::max(epsilon * std::sqrt(sums.rounding[c] / count), 1e-290));
            limits.size[k] = 0.5 * std::log(std::max(sums.square[c] / count, 1e-290));
            limits.floor[k] = std::max(limits.floor[k], least);
            limits.rounding = std::max(limits.rounding, std::exp(least - state.psi[k]));
            if (is_proper(coordinate.prior) || law.inverse_wishart_dof > 0.0) continue;
            const double most = std::max({limits.floor[k], limits.size[k], latent_fit[k]});
            limits.ceiling[k] = std::min(limits.ceiling[k], std::log(1e3) + most);
        }
    }
    return limits;
}

Eigen::VectorXd latent_fit_sizes(const Problem& problem, const BlockSet& set, const State& state,
                                 const std::vector<BlockRows>& rows, double matching) {
    Eigen::VectorXd size = Eigen::VectorXd::Constant(state.psi.size(), -infinity);
    if (set.latents == 0) return size;
    Eigen::VectorXd psi = state.psi;
    for (std::size_t k = 0; k < problem.errors.size(); ++k)
        if (problem.errors[k].start_unknown()) psi[static_cast<Eigen::Index>(k)] = 0.0;
    const WhitenedArrow standard = standard_arrow(set, rows, problem.laws, psi, matching, Curvature::expected, true);
    const std::vector<Eigen::VectorXd> d_z =
        latent_steps(standard.arrow, condense(standard.arrow, 0.0), Eigen::VectorXd::Zero(state.u.size()));
    Eigen::VectorXd square = Eigen::VectorXd::Zero(state.psi.size());
    Eigen::VectorXd count = square;
    const auto add = [&](const std::vector<PartRows>& parts, const Eigen::VectorXd& left) {
        Eigen::Index row = 0;
        for (const PartRows& part : parts) {
            const NoiseModel& law = problem.laws[part.law];
            const Eigen::Index count_of_part = part.records.rows.rows() * law.rows_per_record();
            square[law.first] += left.segment(row, count_of_part).squaredNorm();
            count[law.first] += static_cast<double>(part.records.count);
            row += count_of_part;
        }
    };
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const Eigen::Ref<const Eigen::MatrixXd> linked = standard.linked_rows(b);
        if (linked.rows() > 0)
            add(rows[b].linked_parts, linked.rightCols(1) + linked.leftCols(d_z[b].size()) * d_z[b] +
                                          linked.middleCols(d_z[b].size(), rows[b].next_latents) *
                                              d_z[static_cast<std::size_t>(rows[b].next)]);
        const Eigen::Ref<const Eigen::MatrixXd> own = standard.own_rows(b);
        if (own.rows() == 0) continue;
        const Eigen::VectorXd left = own.rightCols(1) + own.leftCols(d_z[b].size()) * d_z[b];
        add(rows[b].parts, left);
        // Under a covariance shape each row contains parts of the channels before it; the size is accurate enough.
        for (std::size_t i = 0; i < rows[b].channel.size(); ++i)
            for (const NoiseModel& law : problem.laws) {
                if (law.channels.front() != rows[b].channel[i]) continue;
                square[law.first] += left[static_cast<Eigen::Index>(i)] * left[static_cast<Eigen::Index>(i)];
                count[law.first] += 1.0;
            }
    }
    set.spread.sum(square);
    set.spread.sum(count);
    for (const NoiseModel& law : problem.laws)
        if (count[law.first] > 0.0 && square[law.first] > 0.0)
            size[law.first] = psi[law.first] + 0.5 * std::log(square[law.first] / count[law.first]);
    return size;
}

Eigen::VectorXd gap_sizes(const Problem& problem, const BlockSet& set, const std::vector<BlockRows>& rows) {
    const auto count = static_cast<Eigen::Index>(problem.errors.size());
    double gap = 0.0;
    double length = 0.0;
    Eigen::VectorXd own = Eigen::VectorXd::Zero(count);
    for (const BlockRows& block : rows) {
        const Eigen::Index states = block.latents + block.next_latents;
        const auto add = [&](const Eigen::MatrixXd& link) {
            gap += link.rightCols(1).squaredNorm();
            length += link.leftCols(states).squaredNorm();
        };
        if (block.link.rows() > 0) add(block.link);
        for (const PartRows& part : block.linked_parts)
            add(part.records.rows);
        for (const PartRows& part : block.parts)
            own[problem.laws[part.law].first] += part.records.rows.leftCols(block.latents).squaredNorm();
    }
    gap = set.spread.sum(gap);
    length = set.spread.sum(length);
    set.spread.sum(own);
    Eigen::VectorXd size = Eigen::VectorXd::Constant(count, -infinity);
    for (const NoiseModel& law : problem.laws) {
        const double records = set.count[law.channels.front()] * static_cast<double>(law.channels.size());
        if (own[law.first] > 0.0) size[law.first] = 0.5 * std::log(gap / length * own[law.first] / records);
    }
    return size;
}

std::string why_no_covariance(const Problem& problem, const BlockSet& set, const Eigen::VectorXd& psi,
                              Eigen::Index determined) {
    // A response is degenerate if its sd given the others is below this fraction of its own: correlation 1 - 5e-13.
    constexpr double least_share = 1e-6;
    for (const NoiseModel& law : problem.laws) {
        if (!law.joint()) continue;
        const std::size_t m = law.channels.size();
        const double least = static_cast<double>(m) + static_cast<double>(determined) / static_cast<double>(m) + 5.0;
        if (!(law.inverse_wishart_dof > 0.0) && set.count[law.channels.front()] < least)
            return "a full covariance of " + std::to_string(m) + " responses needs at least " +
                   std::to_string(static_cast<int>(std::ceil(least))) + " records of each, or an inverse-Wishart prior";
        const Eigen::MatrixXd lower = covariance_root(law, psi);
        for (Eigen::Index i = 0; i < lower.rows(); ++i) {
            if (lower(i, i) > least_share * lower.row(i).norm()) continue;
            std::string names;
            for (const int c : law.channels)
                names += (names.empty() ? "" : ", ") + group_of(problem, c).name;
            return "the responses " + names +
                   " can be fitted exactly together: their full covariance becomes singular and the likelihood has no "
                   "maximum; estimate a scale for each, or give an inverse-Wishart prior";
        }
    }
    return {};
}

}  // namespace orbid::estimator
