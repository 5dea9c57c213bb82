#include "estimator/linearisation.hpp"

#include <algorithm>

namespace orbid::estimator {

namespace {

/// Replaces the rows of each channel by the triangle of their factorisation where that is shorter.
void compress(BlockRows& block) {
    const Eigen::Index columns = block.rows.cols();
    std::vector<int> channels = block.channel;
    std::sort(channels.begin(), channels.end());
    channels.erase(std::unique(channels.begin(), channels.end()), channels.end());
    if (block.rows.rows() <= 2 * columns * static_cast<Eigen::Index>(channels.size())) return;
    Eigen::MatrixXd shorter(columns * static_cast<Eigen::Index>(channels.size()), columns);
    std::vector<int> shorter_channel;
    Eigen::Index row = 0;
    for (const int channel : channels) {
        const auto count = static_cast<Eigen::Index>(std::count(block.channel.begin(), block.channel.end(), channel));
        Eigen::MatrixXd own(count, columns);
        Eigen::Index k = 0;
        for (std::size_t i = 0; i < block.channel.size(); ++i)
            if (block.channel[i] == channel) own.row(k++) = block.rows.row(static_cast<Eigen::Index>(i));
        const Eigen::Index kept = std::min(count, columns);
        shorter.middleRows(row, kept) = upper_triangle(std::move(own)).topRows(kept);
        shorter_channel.insert(shorter_channel.end(), static_cast<std::size_t>(kept), channel);
        row += kept;
    }
    block.rows = shorter.topRows(row);
    block.channel = std::move(shorter_channel);
}

}  // namespace

std::vector<BlockRows> linearise(const BlockSet& set, const std::vector<BlockValue>& values,
                                 const std::vector<Coordinate>& coordinates, const Eigen::VectorXd& theta,
                                 bool compressed) {
    std::vector<BlockRows> result;
    result.reserve(set.blocks.size());
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        const ActiveBlock& block = set.blocks[b];
        const BlockValue& value = values[b];
        BlockRows rows{{}, block.channel, block.latents, &block.cholesky};
        rows.rows.resize(value.e.size(), block.latents + theta.size() + 1);
        if (block.latents > 0) rows.rows.leftCols(block.latents) = value.e_z;
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            rows.rows.col(block.latents + i) =
                value.e_theta.col(i) * coordinates[static_cast<std::size_t>(i)].slope(theta[i]);
        rows.rows.rightCols(1) = value.e;
        if (compressed && block.cholesky.size() == 0) compress(rows);
        result.push_back(std::move(rows));
    }
    return result;
}

std::vector<BlockRows> in_basis(const std::vector<BlockRows>& rows, const Eigen::MatrixXd& basis) {
    std::vector<BlockRows> result;
    result.reserve(rows.size());
    for (const BlockRows& block : rows) {
        BlockRows reduced{{}, block.channel, block.latents, block.cholesky};
        reduced.rows.resize(block.rows.rows(), block.latents + basis.cols() + 1);
        reduced.rows.leftCols(block.latents) = block.rows.leftCols(block.latents);
        reduced.rows.middleCols(block.latents, basis.cols()) =
            block.rows.middleCols(block.latents, basis.rows()) * basis;
        reduced.rows.rightCols(1) = block.rows.rightCols(1);
        result.push_back(std::move(reduced));
    }
    return result;
}

Eigen::MatrixXd whitened(const BlockRows& block, const Eigen::VectorXd& scale) {
    Eigen::MatrixXd rows = block.rows;
    whiten(block.channel, *block.cholesky, scale, rows);
    return rows;
}

Arrow whitened_arrow(const std::vector<BlockRows>& rows, const Eigen::VectorXd& scale) {
    std::vector<BlockTriangle> blocks;
    blocks.reserve(rows.size());
    Eigen::Index parameters = 0;
    for (const BlockRows& block : rows) {
        parameters = block.rows.cols() - block.latents - 1;
        blocks.push_back(block_triangle(whitened(block, scale), block.latents));
    }
    return factorise(std::move(blocks), parameters);
}

}  // namespace orbid::estimator
