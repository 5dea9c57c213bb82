#include <map>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "estimator/chain.hpp"

namespace orbid::estimator {

namespace {

/// Covariance of (pivots, separator) from that of the separator s: z = G s + R^-1 noise, G = -R^-1 R_s.
Eigen::MatrixXd extended(const Elimination& step, const Eigen::MatrixXd& separator) {
    const Eigen::Index l = step.pivots;
    const Eigen::Index s = separator.rows();
    const auto r = step.rows.leftCols(step.rank).triangularView<Eigen::Upper>();
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(step.rank, step.rank);
    if (step.rank > 0) r.solveInPlace(inverse);
    Eigen::MatrixXd gain = -step.rows.middleCols(step.rank, s);
    if (gain.size() > 0) r.solveInPlace(gain);  // Eigen binds a reference to the first element
    Eigen::MatrixXd scattered_inverse = Eigen::MatrixXd::Zero(l, step.rank);
    Eigen::MatrixXd scattered_gain = Eigen::MatrixXd::Zero(l, s);
    for (Eigen::Index k = 0; k < step.rank; ++k) {
        const Eigen::Index j = step.order[static_cast<std::size_t>(k)];
        scattered_inverse.row(j) = inverse.row(k);
        scattered_gain.row(j) = gain.row(k);
    }
    Eigen::MatrixXd result(l + s, l + s);
    const Eigen::MatrixXd across = scattered_gain * separator;
    const Eigen::MatrixXd own = scattered_inverse * scattered_inverse.transpose() + across * scattered_gain.transpose();
    result.topLeftCorner(l, l) = 0.5 * (own + own.transpose());
    result.topRightCorner(l, s) = across;
    result.bottomLeftCorner(s, l) = across.transpose();
    result.bottomRightCorner(s, s) = separator;
    return result;
}

/// Rows and columns of three groups in another order; a group may be left out.
Eigen::MatrixXd picked(const Eigen::MatrixXd& from, const std::vector<std::pair<Eigen::Index, Eigen::Index>>& groups) {
    Eigen::Index size = 0;
    for (const auto& group : groups)
        size += group.second;
    Eigen::MatrixXd result(size, size);
    Eigen::Index row = 0;
    for (const auto& rows : groups) {
        Eigen::Index column = 0;
        for (const auto& columns : groups) {
            result.block(row, column, rows.second, columns.second) =
                from.block(rows.first, columns.first, rows.second, columns.second);
            column += columns.second;
        }
        row += rows.second;
    }
    return result;
}

}  // namespace

void chain_covariance(const ChainFactor& chain, const Eigen::MatrixXd& parameter_covariance,
                      std::vector<Eigen::MatrixXd>& node, std::vector<Eigen::MatrixXd>& link) {
    const Eigen::Index r = parameter_covariance.rows();
    // after[i]: covariance of (z_i, z of the following node of the moment, y), one entry per link of the moment.
    std::vector<Eigen::MatrixXd> after(chain.block.size());
    const auto latents = [&chain](std::ptrdiff_t i) { return chain.latents[static_cast<std::size_t>(i)]; };
    const auto block = [&chain](std::ptrdiff_t i) { return chain.block[static_cast<std::size_t>(i)]; };

    const Elimination& last = chain.levels.back().front();
    const Eigen::MatrixXd whole = extended(last, parameter_covariance);
    const Eigen::Index l = latents(last.node);
    const Eigen::Index l_partner = last.partner >= 0 ? latents(last.partner) : 0;
    const Eigen::Index y = l + l_partner;
    node[block(last.node)] = picked(whole, {{0, l}, {y, r}});
    if (last.partner >= 0) {
        node[block(last.partner)] = picked(whole, {{l, l_partner}, {y, r}});
        after[static_cast<std::size_t>(last.node)] = whole;
        if (chain.cyclic)
            after[static_cast<std::size_t>(last.partner)] = picked(whole, {{l, l_partner}, {0, l}, {y, r}});
    } else if (chain.cyclic) {
        after[static_cast<std::size_t>(last.node)] = picked(whole, {{0, l}, {0, l}, {y, r}});
    }
    for (auto level = chain.levels.rbegin() + 1; level != chain.levels.rend(); ++level) {
        const auto expand = [&](std::size_t k) {
            const Elimination& step = (*level)[k];
            const Eigen::Index l_own = latents(step.node);
            const Eigen::Index l_left = latents(step.left);
            const Eigen::Index l_right = latents(step.right);
            Eigen::MatrixXd& between = after[static_cast<std::size_t>(step.left)];
            const Eigen::MatrixXd joint = extended(step, between);
            const Eigen::Index common = l_own + l_left + l_right;
            node[block(step.node)] = picked(joint, {{0, l_own}, {common, r}});
            between = picked(joint, {{l_own, l_left}, {0, l_own}, {common, r}});
            after[static_cast<std::size_t>(step.node)] =
                picked(joint, {{0, l_own}, {l_own + l_left, l_right}, {common, r}});
        };
        if (level->size() >= 32)
            oneapi::tbb::parallel_for(std::size_t{0}, level->size(), expand);
        else
            for (std::size_t k = 0; k < level->size(); ++k)
                expand(k);
    }
    for (std::size_t i = 0; i < after.size(); ++i)
        link[chain.block[i]] = std::move(after[i]);
}

}  // namespace orbid::estimator
